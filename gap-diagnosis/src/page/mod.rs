//! Self-contained HTML pages with plots: one file, readable offline, no request to anywhere.
//!
//! [`Page`] is the sheet, [`Chart`] a plot on it. The builders [`simulation_page`], [`replay_page`], [`identify_page`] and
//! [`diagnosis_page`] take plain data and lay out what the commands of the same name show; a report of another kind puts its own page
//! together from the same parts.
//!
//! What this module does not do: compute. It thins, rounds and subtracts; autocorrelations, spectra and fits come from the caller.
//! Names and texts may come from anybody's log file: everything goes through one escape function, and the page's content security
//! policy lets no script run but its own.

mod bars;
mod chart;
mod compare;
mod design;
mod diagnosis;
mod heat;
mod identify;
mod location;
mod matrix;
mod number;
mod replay;
mod response;
mod simulation;
mod thin;

use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::Path;

pub use bars::{BarItem, BarList, Share};
pub use chart::{Axis, Chart, Ink, Kept, Loop, Panel, Series};
pub use compare::{CompareView, ComparedModel, compare_page};
pub use design::{BodeView, DesignView, PlaneView, TableView, design_page, pole};
pub use diagnosis::{
    ChangedView, ClassView, DiagnosedLog, DiagnosisView, EffectView, EstimateView, GapView, NextView, RankView,
    RivalView, ShareView, UnexplainedView, diagnosis_page,
};
pub use heat::{HeatMap, HeatScale, Strip};
pub use identify::{FittedLog, FittedParameter, IdentifyView, OrderView, StartView, identify_page};
pub use matrix::Matrix;
pub use number::four_digits;
pub use replay::{ReplayView, SpectrumView, replay_page};
pub use response::{ModelResponse, ResponseView};
pub use simulation::{SimulationView, simulation_page};
pub use thin::{Spacing, decimate, thin_path};

const UPLOT_JS: &str = include_str!("../../assets/uPlot.iife.min.js");
const UPLOT_CSS: &str = include_str!("../../assets/uPlot.min.css");
const UPLOT_LICENSE: &str = include_str!("../../assets/uPlot-LICENSE");
const PAGE_JS: &str = include_str!("../../assets/page.js");
const PAGE_CSS: &str = include_str!("../../assets/page.css");

/// Bytes of chart data on one page. With the 60 kB of script and style this keeps a page of any run under 1.5 MB, small enough to mail.
const DATA_BUDGET_BYTES: usize = 1_300_000;

/// One HTML file in the making. Everything is shown in the order in which it was added.
#[derive(Debug, Clone)]
pub struct Page {
    title: String,
    subtitle: String,
    headline: String,
    warnings: Vec<String>,
    blocks: Vec<Block>,
    provenance: Vec<String>,
}

#[derive(Debug, Clone)]
enum Block {
    Html(String),
    Chart(Box<Chart>),
}

impl Page {
    /// A page with nothing on it but its title.
    pub fn new(title: &str) -> Self {
        Self {
            title: title.to_owned(),
            subtitle: String::new(),
            headline: String::new(),
            warnings: Vec::new(),
            blocks: Vec::new(),
            provenance: Vec::new(),
        }
    }

    /// A line under the title: which plant, which log.
    pub fn subtitle(&mut self, text: &str) -> &mut Self {
        text.clone_into(&mut self.subtitle);
        self
    }

    /// The verdict in one sentence, the first thing read.
    pub fn headline(&mut self, text: &str) -> &mut Self {
        text.clone_into(&mut self.headline);
        self
    }

    /// Something the reader must know before trusting the plots; shown below the headline wherever it was added.
    pub fn warning(&mut self, text: &str) -> &mut Self {
        self.warnings.push(text.to_owned());
        self
    }

    /// Starts a section.
    pub fn section(&mut self, heading: &str) -> &mut Self {
        self.html(format!("<h2>{}</h2>\n", escape(heading)))
    }

    /// A paragraph.
    pub fn paragraph(&mut self, text: &str) -> &mut Self {
        self.html(format!("<p class=\"text\">{}</p>\n", escape(text)))
    }

    /// The numbers that matter, as cards: label and value with unit. A terminal's `um` is a page's `µm`.
    pub fn facts(&mut self, facts: &[(String, String)]) -> &mut Self {
        if facts.is_empty() {
            return self;
        }
        let cards: String = facts
            .iter()
            .map(|(label, value)| {
                let value = value.strip_suffix(" um").map_or_else(|| value.clone(), |number| format!("{number} µm"));
                format!("<div><dt>{}</dt><dd>{}</dd></div>", escape(label), escape(&value))
            })
            .collect();
        self.html(format!("<dl class=\"facts\">{cards}</dl>\n"))
    }

    /// A table; columns of numbers are set flush right.
    pub fn table(&mut self, caption: &str, header: &[&str], rows: &[Vec<String>]) -> &mut Self {
        self.linked_table(caption, header, rows, &[])
    }

    /// A table whose rows lead to other pages: the first cell of a row is its link, relative to this page. An empty link is none.
    pub fn linked_table(
        &mut self,
        caption: &str,
        header: &[&str],
        rows: &[Vec<String>],
        links: &[String],
    ) -> &mut Self {
        // Column by column, header included; dashes stand for missing numbers.
        let is_right = |column_idx: usize| {
            let mut cells = rows.iter().filter_map(|row| row.get(column_idx)).filter(|cell| cell.as_str() != "–");
            !rows.is_empty() && cells.all(|cell| starts_as_number(cell))
        };
        let class = |column_idx: usize| {
            if is_right(column_idx) { " class=\"number\"" } else { "" }
        };
        let head: String = header
            .iter()
            .enumerate()
            .map(|(column_idx, cell)| format!("<th scope=\"col\"{}>{}</th>", class(column_idx), escape(cell)))
            .collect();
        let body: String = rows
            .iter()
            .enumerate()
            .map(|(row_idx, row)| {
                let link = links.get(row_idx).filter(|link| !link.is_empty());
                let cells: String = row
                    .iter()
                    .enumerate()
                    .map(|(column_idx, cell)| match (column_idx, link) {
                        (0, Some(link)) => format!(
                            "<th scope=\"row\"{}><a href=\"{}\">{}</a></th>",
                            class(0),
                            escape(link),
                            escape(cell)
                        ),
                        (0, None) => format!("<th scope=\"row\"{}>{}</th>", class(0), escape(cell)),
                        _ => format!("<td{}>{}</td>", class(column_idx), escape(cell)),
                    })
                    .collect();
                format!("<tr>{cells}</tr>\n")
            })
            .collect();
        self.html(format!(
            "<p class=\"caption\">{caption}</p>\n<div class=\"table\" tabindex=\"0\" role=\"region\" aria-label=\"{caption}\"><table>\
             <thead><tr>{head}</tr></thead><tbody>\n{body}</tbody></table></div>\n",
            caption = escape(caption)
        ))
    }

    /// A plot.
    pub fn chart(&mut self, chart: Chart) -> &mut Self {
        self.blocks.push(Block::Chart(Box::new(chart)));
        self
    }

    /// Several plots.
    pub fn charts(&mut self, charts: Vec<Chart>) -> &mut Self {
        for chart in charts {
            self.chart(chart);
        }
        self
    }

    /// How this page came about, at its foot: command line, seed, versions.
    pub fn provenance(&mut self, lines: &[String]) -> &mut Self {
        self.provenance.extend_from_slice(lines);
        self
    }

    /// The whole file.
    pub fn to_html(&self) -> String {
        let has_charts = self.blocks.iter().any(|block| matches!(block, Block::Chart(_)));
        let data = self.chart_data();
        let is_wide = self.widths();
        let mut body = String::new();
        let mut data = data.iter().zip(&is_wide);
        let mut chart_idx = 0;
        let mut grid_open = false;
        for block in &self.blocks {
            let is_chart = matches!(block, Block::Chart(_));
            if is_chart != grid_open {
                body += if is_chart { "<div class=\"charts\">\n" } else { "</div>\n" };
                grid_open = is_chart;
            }
            match block {
                Block::Html(html) => body += html,
                Block::Chart(chart) => {
                    chart_idx += 1;
                    let (data, &is_wide) = data.next().expect("one per chart");
                    body += &chart.html(chart_idx, is_wide, data, escape);
                }
            }
        }
        if grid_open {
            body += "</div>\n";
        }

        let mut head = format!("<h1>{}</h1>\n", escape(&self.title));
        if !self.subtitle.is_empty() {
            head += &format!("<p class=\"subtitle\">{}</p>\n", escape(&self.subtitle));
        }
        if !self.headline.is_empty() {
            head += &format!("<p class=\"headline\">{}</p>\n", escape(&self.headline));
        }
        if !self.warnings.is_empty() {
            let items: String =
                self.warnings.iter().map(|text| format!("<li><b>Warning:</b> {}</li>\n", escape(text))).collect();
            head += &format!("<ul class=\"warnings\">\n{items}</ul>\n");
        }
        if has_charts {
            head += "<p class=\"help\">Drag in a plot to zoom, double-click to see all again; a name in a legend shows or hides its curve. \
                     Keyboard: Tab to a plot, arrows move along it, + and − zoom, 0 shows all.</p>\n\
                     <noscript><p class=\"warnings\">The plots need JavaScript, which is switched off here; numbers and tables do not.</p></noscript>\n";
        }
        let foot = if self.provenance.is_empty() {
            String::new()
        } else {
            let lines: Vec<String> = self.provenance.iter().map(|line| escape(line)).collect();
            format!("<footer><h2>How this page was made</h2><pre>{}</pre></footer>\n", lines.join("\n"))
        };

        let nonce = nonce(&[&head, &body, &foot]);
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; \
             img-src data:; base-uri 'none'; form-action 'none'\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<meta name=\"color-scheme\" content=\"light dark\">\n\
             <title>{title}</title>\n<link rel=\"icon\" href=\"data:,\">\n\
             <style nonce=\"{nonce}\">\n{UPLOT_CSS}\n{PAGE_CSS}</style>\n</head>\n<body>\n\
             <button type=\"button\" id=\"theme\" hidden>dark</button>\n<main>\n<header>\n{head}</header>\n{body}</main>\n{foot}\
             <script nonce=\"{nonce}\">\n/*! The plots are drawn by uPlot.\n{UPLOT_LICENSE}\n*/\n{UPLOT_JS}\n</script>\n\
             <script nonce=\"{nonce}\">\n{PAGE_JS}</script>\n</body>\n</html>\n",
            title = escape(&self.title),
        )
    }

    /// Writes the page. A reader never sees half a file: it is written beside its place and then renamed.
    ///
    /// # Errors
    /// What the file system says; no partial file is left behind.
    pub fn save(&self, path: &Path) -> std::io::Result<()> {
        plant_sim::whole_file::write(path, self.to_html().as_bytes())
    }

    fn html(&mut self, html: String) -> &mut Self {
        self.blocks.push(Block::Html(html));
        self
    }

    /// Whether each chart takes the whole width: those that ask for it, and the one that would be left without a neighbour.
    fn widths(&self) -> Vec<bool> {
        let mut is_wide: Vec<bool> = Vec::new();
        let mut has_neighbour = true;
        for block in &self.blocks {
            match block {
                Block::Chart(chart) if !chart.is_wide() => {
                    is_wide.push(false);
                    has_neighbour = !has_neighbour;
                    continue;
                }
                _ if !has_neighbour => {
                    if let Some(last) = is_wide.last_mut() {
                        *last = true;
                    }
                    has_neighbour = true;
                }
                _ => {}
            }
            if matches!(block, Block::Chart(_)) {
                is_wide.push(true);
            }
        }
        if !has_neighbour && let Some(last) = is_wide.last_mut() {
            *last = true;
        }
        is_wide
    }

    /// JSON and number of drawn samples of every chart, all coarser alike if together they were too large.
    fn chart_data(&self) -> Vec<(String, usize)> {
        let charts: Vec<&Chart> = self
            .blocks
            .iter()
            .filter_map(|block| match block {
                Block::Chart(chart) => Some(chart.as_ref()),
                Block::Html(_) => None,
            })
            .collect();
        let mut divisor = 1;
        loop {
            let data: Vec<(String, usize)> = charts
                .iter()
                .map(|chart| chart.json(divisor))
                .map(|(json, n_drawn)| (escape_json(&json), n_drawn))
                .collect();
            let n_bytes: usize = data.iter().map(|(json, _)| json.len()).sum();
            // 6000 / 16 = 375 points are the least that still looks like a curve; a page beyond that has a hundred charts and may be larger.
            if divisor >= 16 || n_bytes <= DATA_BUDGET_BYTES {
                return data;
            }
            divisor *= 2;
        }
    }
}

/// Text as HTML, safe between tags and inside double-quoted attributes.
fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => escaped += "&amp;",
            '<' => escaped += "&lt;",
            '>' => escaped += "&gt;",
            '"' => escaped += "&quot;",
            '\'' => escaped += "&#39;",
            // Control characters and the marks that reverse the reading direction could make a name look like another.
            '\u{0}'..='\u{8}'
            | '\u{b}'..='\u{1f}'
            | '\u{7f}'..='\u{9f}'
            | '\u{202a}'..='\u{202e}'
            | '\u{2066}'..='\u{2069}' => {
                escaped.push('\u{fffd}');
            }
            _ => escaped.push(letter),
        }
    }
    escaped
}

/// JSON that cannot end the script element it stands in: these letters occur in its strings only, where the escape means the same.
fn escape_json(json: &str) -> String {
    json.replace('<', "\\u003c").replace('>', "\\u003e").replace('&', "\\u0026")
}

fn starts_as_number(cell: &str) -> bool {
    let digits = cell.trim_start_matches(['+', '-', '−', '±', '<', '>', '≥', '≤', ' ']);
    digits.starts_with(|letter: char| letter.is_ascii_digit())
}

/// A number used once, as the content security policy wants it. It is a hash of all that is shown: the same data give the same page,
/// and whoever chose a hostile name could not know the nonce of a page that contains it.
fn nonce(parts: &[&str]) -> String {
    let mut hasher = DefaultHasher::new();
    parts.hash(&mut hasher);
    let first = hasher.finish();
    "again".hash(&mut hasher);
    format!("{first:016x}{:016x}", hasher.finish())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hostile_text_stays_text() {
        assert_eq!(escape("<a b='c' d=\"e\">&"), "&lt;a b=&#39;c&#39; d=&quot;e&quot;&gt;&amp;");
        assert_eq!(escape("x\u{202e}y\u{0}"), "x\u{fffd}y\u{fffd}");
        let json = escape_json(&serde_json::to_string("</script><!-- &").expect("a string"));
        assert!(!json.contains(['<', '>', '&']));
        assert_eq!(serde_json::from_str::<String>(&json).expect("valid JSON"), "</script><!-- &");
    }

    #[test]
    fn numbers_are_told_from_words() {
        for cell in ["12 µm", "−3", "± 4", "<0.1", "0"] {
            assert!(starts_as_number(cell), "{cell}");
        }
        for cell in ["", "–", "beta1", "not seen"] {
            assert!(!starts_as_number(cell), "{cell}");
        }
    }

    #[test]
    fn a_chart_without_a_neighbour_is_wide() {
        let half = || Chart::points("", "", Axis::new("", ""), Axis::new("", ""), &[], &[]);
        let mut page = Page::new("");
        page.chart(half()).chart(half()).chart(half()).chart(half().wide()).chart(half());
        page.section("next").chart(half()).chart(half()).section("end");
        assert_eq!(page.widths(), [false, false, true, true, true, false, false]);
    }

    #[test]
    fn the_nonce_follows_the_content() {
        assert_eq!(nonce(&["a", "b"]), nonce(&["a", "b"]));
        assert_ne!(nonce(&["a", "b"]), nonce(&["ab", ""]));
    }
}
