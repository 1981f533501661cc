//! A matrix of named rows and columns as inline SVG: what was so against what was said.

use super::{Page, escape};

/// Drawing units (about pixels): room for the names, and a cell.
const LEFT: f64 = 220.0;
const TOP: f64 = 190.0;
const CELL: f64 = 27.0;
/// Room at the right for the last names, which lean over.
const RIGHT: f64 = 120.0;

/// Values over two lists of names.
#[derive(Debug, Clone)]
pub struct Matrix {
    /// Heading.
    pub title: String,
    /// What to look for.
    pub caption: String,
    /// Names of the rows, from the top.
    pub rows: Vec<String>,
    /// Names of the columns.
    pub columns: Vec<String>,
    /// Numbers written in the cells, row by row; zeros stay empty. A cell's colour is its share of its row.
    pub counts: Vec<Vec<usize>>,
}

impl Page {
    /// A matrix of counts, the full width of the page.
    pub fn matrix(&mut self, matrix: &Matrix) -> &mut Self {
        let (width, height) = (CELL * matrix.columns.len() as f64, CELL * matrix.rows.len() as f64);
        let (right, bottom) = (LEFT + width, TOP + height);
        let mut drawn = String::new();
        for (row_idx, (name, counts)) in matrix.rows.iter().zip(&matrix.counts).enumerate() {
            let (top, total) = (TOP + CELL * row_idx as f64, counts.iter().sum::<usize>().max(1));
            drawn += &format!(
                "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>\n",
                LEFT - 8.0,
                top + 0.5 * CELL + 4.5,
                escape(name)
            );
            for (column_idx, count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
                let left = LEFT + CELL * column_idx as f64;
                let answer = matrix.columns.get(column_idx).map_or("", String::as_str);
                // What is right is blue, what is wrong vermillion: the eye finds the failures.
                let ink = if answer == name { "cold" } else { "warm" };
                // Even one case of many is to be seen, and the number in the cell to be read.
                let opacity = 0.15 + 0.5 * *count as f64 / total as f64;
                drawn += &format!(
                    "<rect class=\"{ink}\" x=\"{left:.1}\" y=\"{top:.1}\" width=\"{CELL}\" height=\"{CELL}\" fill-opacity=\"{opacity:.2}\">\
                     <title>{} answered {}: {count} of {total}</title></rect>\
                     <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" pointer-events=\"none\">{count}</text>\n",
                    escape(name),
                    escape(answer),
                    left + 0.5 * CELL,
                    top + 0.5 * CELL + 4.5,
                );
            }
        }
        for (column_idx, name) in matrix.columns.iter().enumerate() {
            let x = LEFT + CELL * (column_idx as f64 + 0.6);
            drawn +=
                &format!("<text transform=\"translate({x:.1} {}) rotate(-55)\">{}</text>\n", TOP - 8.0, escape(name));
        }
        let mut lines = String::new();
        for row_idx in 0..=matrix.rows.len() {
            lines += &format!("M{LEFT} {:.1}H{right}", TOP + CELL * row_idx as f64);
        }
        for column_idx in 0..=matrix.columns.len() {
            lines += &format!("M{:.1} {TOP}V{bottom}", LEFT + CELL * column_idx as f64);
        }
        self.html(format!(
            "<figure class=\"matrix\"><h3>{title}</h3><figcaption>{}</figcaption>\n\
             <svg viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{title}\"><path class=\"lines\" d=\"{lines}\"/>\n{drawn}</svg></figure>\n",
            escape(&matrix.caption),
            right + RIGHT,
            bottom + 4.0,
            title = escape(&matrix.title),
        ))
    }
}
