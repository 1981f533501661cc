//! Bars: a whole split into parts, and lists of parts with their percentages.

use super::number::{four_digits, short_percent};
use super::{Ink, Page, escape};

/// A part of a stacked bar, see [`Page::bar`].
#[derive(Debug, Clone, Copy)]
pub struct Share<'a> {
    /// What it is.
    pub label: &'a str,
    /// How much, not negative.
    pub value: f64,
    /// Its colour.
    pub ink: Ink,
}

/// A line of [`BarList`].
#[derive(Debug, Clone)]
pub struct BarItem {
    /// What it is.
    pub label: String,
    /// How much.
    pub percent: f64,
    /// A second, paler bar behind it, to compare with: what it was before, or what chance would give.
    pub behind_percent: Option<f64>,
    /// A remark after the number; empty for none.
    pub note: String,
}

/// A list of bars with a heading, see [`Page::bar_lists`].
#[derive(Debug, Clone)]
pub struct BarList {
    /// Heading.
    pub title: String,
    /// What to look for.
    pub caption: String,
    /// Colour of the bars.
    pub ink: Ink,
    /// What fills the whole width; the largest of the items where it is none.
    pub full_percent: Option<f64>,
    /// The bars, from the top.
    pub items: Vec<BarItem>,
}

impl Page {
    /// A whole split into its parts, as one bar with a legend: e.g. a gap into noise, explained and unexplained.
    ///
    /// Parts that are not finite or not positive take no room in the bar but keep their line in the legend.
    pub fn bar(&mut self, caption: &str, unit: &str, shares: &[Share<'_>]) -> &mut Self {
        let length = |share: &Share<'_>| {
            if share.value.is_finite() { share.value.max(0.0) } else { 0.0 }
        };
        let total: f64 = shares.iter().map(length).sum();
        let mut at_percent = 0.0;
        let mut parts = String::new();
        let mut keys = String::new();
        for share in shares {
            let percent = if total > 0.0 { 100.0 * length(share) / total } else { 0.0 };
            let ink = share.ink.class();
            parts += &format!(
                "<rect class=\"{ink}\" x=\"{at_percent:.3}%\" y=\"0\" width=\"{percent:.3}%\" height=\"100%\"></rect>"
            );
            keys += &format!(
                "<li><i class=\"swatch block {ink}\"></i>{}: {} ({})</li>",
                escape(share.label),
                escape(&four_digits(share.value, unit)),
                short_percent(percent)
            );
            at_percent += percent;
        }
        self.html(format!(
            "<figure class=\"bar\"><figcaption>{caption}</figcaption><svg role=\"img\" aria-label=\"{caption}\">{parts}</svg><ul>{keys}</ul></figure>\n",
            caption = escape(caption)
        ))
    }

    /// Lists of horizontal bars with percentages, two lists side by side where there is room.
    pub fn bar_lists(&mut self, lists: &[BarList]) -> &mut Self {
        if lists.is_empty() {
            return self;
        }
        let figures: String = lists.iter().map(bar_list).collect();
        self.html(format!("<div class=\"maps\">\n{figures}</div>\n"))
    }
}

fn bar_list(list: &BarList) -> String {
    let largest = list
        .items
        .iter()
        .flat_map(|item| [Some(item.percent), item.behind_percent])
        .flatten()
        .filter(|percent| percent.is_finite())
        .fold(0.0, f64::max);
    let full = list.full_percent.unwrap_or(largest);
    let width = |percent: f64| {
        if full > 0.0 && percent.is_finite() { (100.0 * percent / full).clamp(0.0, 100.0) } else { 0.0 }
    };
    let rows: String = list
        .items
        .iter()
        .map(|item| {
            let behind = item.behind_percent.map_or(String::new(), |percent| {
                format!("<rect class=\"behind\" x=\"0\" y=\"0\" width=\"{:.2}%\" height=\"100%\"></rect>", width(percent))
            });
            format!(
                "<tr><th scope=\"row\">{}</th><td><svg aria-hidden=\"true\">{behind}\
                 <rect class=\"{}\" x=\"0\" y=\"20%\" width=\"{:.2}%\" height=\"60%\"></rect></svg></td><td>{}</td><td>{}</td></tr>\n",
                escape(&item.label),
                list.ink.class(),
                width(item.percent),
                short_percent(item.percent),
                escape(&item.note)
            )
        })
        .collect();
    format!(
        "<figure class=\"bars\"><h3>{}</h3><figcaption>{}</figcaption><table><tbody>\n{rows}</tbody></table></figure>\n",
        escape(&list.title),
        escape(&list.caption)
    )
}
