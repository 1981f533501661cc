//! Heat maps and strips: coloured cells as inline SVG, which needs no script and prints.
//!
//! A cell is the ground of the page under one ink whose opacity is the value, so one drawing serves the light and the dark theme.
//! The two inks of a diverging scale are blue and vermillion of the Okabe-Ito palette, which colour-blind readers tell apart.

use super::number::{four_digits, three_digits};
use super::{Axis, Page, escape};

/// Drawing units (about pixels): the plot's corner, its size, and the whole.
const LEFT: f64 = 70.0;
const TOP: f64 = 10.0;
const WIDTH: f64 = 400.0;
const HEIGHT: f64 = 330.0;
const FULL_WIDTH: f64 = 572.0;
const FULL_HEIGHT: f64 = 368.0;
/// The colour scale to the right of the plot.
const SCALE_LEFT: f64 = 488.0;
const SCALE_WIDTH: f64 = 16.0;
const SCALE_STEPS: usize = 40;
/// Part of the cells whose values the scale covers; the few beyond have its end colour.
const COVER: f64 = 0.98;

/// What the colours mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HeatScale {
    /// From blue (negative) over the ground (zero) to vermillion (positive), the same length on both sides.
    Diverging,
    /// From the ground (zero) to vermillion.
    Sequential,
}

/// Values over two quantities, in bins.
#[derive(Debug, Clone)]
pub struct HeatMap {
    /// Heading.
    pub title: String,
    /// What to look for.
    pub caption: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Edges of the columns, ascending, one more than columns. Columns are drawn equally wide whatever they cover.
    pub x_edges: Vec<f64>,
    /// Edges of the rows, from the bottom.
    pub y_edges: Vec<f64>,
    /// `values[row * n_columns + column]`; NaN for a bin without data.
    pub values: Vec<f64>,
    /// Name of the values, for the scale.
    pub quantity: String,
    /// Their unit.
    pub unit: String,
    /// What the colours mean.
    pub scale: HeatScale,
    /// Value at the end of the scale, to compare maps; from the values if none.
    pub limit: Option<f64>,
}

impl HeatMap {
    /// Value at the end of the scale: that which 98 % of the cells stay below, unless it was given.
    pub fn limit(&self) -> f64 {
        self.limit.filter(|&limit| limit > 0.0 && limit.is_finite()).unwrap_or_else(|| limit(&self.values))
    }
}

/// A row of equal cells, e.g. a log in twenty stretches.
#[derive(Debug, Clone)]
pub struct Strip {
    /// What the row is.
    pub label: String,
    /// At its right end, e.g. the duration.
    pub note: String,
    /// Value per cell; the darkest of all strips is the largest.
    pub values: Vec<f64>,
    /// Per cell: what a pointer resting on it tells.
    pub readings: Vec<String>,
}

impl Page {
    /// Heat maps, two side by side where there is room.
    ///
    /// # Panics
    /// If a map hasn't one value per bin.
    pub fn heat_maps(&mut self, maps: &[HeatMap]) -> &mut Self {
        if maps.is_empty() {
            return self;
        }
        let figures: String = maps.iter().map(heat_map).collect();
        self.html(format!("<div class=\"maps\">\n{figures}</div>\n"))
    }

    /// Rows of cells under one another, coloured by value; hue and scale as in a sequential heat map.
    pub fn strips(&mut self, title: &str, caption: &str, strips: &[Strip]) -> &mut Self {
        let largest = strips.iter().flat_map(|strip| &strip.values).copied().fold(0.0, f64::max);
        if strips.is_empty() {
            return self;
        }
        let rows: String = strips
            .iter()
            .map(|strip| {
                let width = 100.0 / strip.values.len().max(1) as f64;
                let cells: String = strip
                    .values
                    .iter()
                    .enumerate()
                    .map(|(idx, &value)| {
                        let reading = strip.readings.get(idx).map_or("", String::as_str);
                        let opacity = if largest > 0.0 { value / largest } else { 0.0 };
                        format!(
                            "<rect class=\"warm\" x=\"{:.3}%\" y=\"0\" width=\"{width:.3}%\" height=\"100%\" fill-opacity=\"{opacity:.2}\"><title>{}</title></rect>",
                            width * idx as f64,
                            escape(reading)
                        )
                    })
                    .collect();
                format!(
                    "<div class=\"row\"><span>{label}</span><svg role=\"img\" aria-label=\"{label}\">{cells}</svg><span>{}</span></div>\n",
                    escape(&strip.note),
                    label = escape(&strip.label)
                )
            })
            .collect();
        self.html(format!(
            "<figure class=\"strips\"><h3>{}</h3><figcaption>{}</figcaption>\n{rows}</figure>\n",
            escape(title),
            escape(caption)
        ))
    }
}

fn heat_map(map: &HeatMap) -> String {
    let (n_columns, n_rows) = (map.x_edges.len().saturating_sub(1), map.y_edges.len().saturating_sub(1));
    assert_eq!(map.values.len(), n_columns * n_rows, "{}: one value per bin", map.title);
    let limit = map.limit();
    let (cell_width, cell_height) = (WIDTH / n_columns.max(1) as f64, HEIGHT / n_rows.max(1) as f64);
    let mut ground = String::new();
    let mut cells = String::new();
    for (idx, &value) in map.values.iter().enumerate().filter(|(_, value)| value.is_finite()) {
        let (column, row) = (idx % n_columns, idx / n_columns);
        let (left, top) = (LEFT + cell_width * column as f64, TOP + HEIGHT - cell_height * (row + 1) as f64);
        ground += &format!("M{left:.1} {top:.1}h{cell_width:.2}v{cell_height:.2}h-{cell_width:.2}z");
        let range = |edges: &[f64], bin: usize, axis: &Axis| {
            format!("{} to {}", three_digits(edges[bin]), four_units(edges[bin + 1], axis))
        };
        cells += &format!(
            "<rect class=\"{}\" x=\"{left:.1}\" y=\"{top:.1}\" width=\"{cell_width:.2}\" height=\"{cell_height:.2}\" fill-opacity=\"{:.2}\"><title>{}, {}: {}</title></rect>\n",
            hue(value),
            (value.abs() / limit).min(1.0),
            escape(&range(&map.x_edges, column, &map.x)),
            escape(&range(&map.y_edges, row, &map.y)),
            escape(&four_digits(value, &map.unit)),
        );
    }
    let (bottom, right) = (TOP + HEIGHT, LEFT + WIDTH);
    let mut ticks = String::new();
    for (value, place) in tick_places(&map.x_edges) {
        let x = LEFT + WIDTH * place;
        ticks += &format!(
            "<path d=\"M{x:.1} {bottom}v6\"/><text x=\"{x:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
            bottom + 20.0,
            three_digits(value)
        );
    }
    for (value, place) in tick_places(&map.y_edges) {
        let y = bottom - HEIGHT * place;
        ticks += &format!(
            "<path d=\"M{LEFT} {y:.1}h-6\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            LEFT - 10.0,
            y + 5.0,
            three_digits(value)
        );
    }
    format!(
        "<figure class=\"heat\"><h3>{title}</h3><p class=\"y-title\">{y_title}</p>\n\
         <svg viewBox=\"0 0 {FULL_WIDTH} {FULL_HEIGHT}\" role=\"img\" aria-label=\"{title}\">\
         <path class=\"unknown\" d=\"M{LEFT} {TOP}H{right}V{bottom}H{LEFT}z\"/><path class=\"known\" d=\"{ground}\"/>\n{cells}\
         <path class=\"frame\" d=\"M{LEFT} {TOP}H{right}V{bottom}H{LEFT}z\"/><g class=\"ticks\">{ticks}{scale}</g></svg>\n\
         <p class=\"x-title\">{x_title}</p><figcaption>{caption} Colour: {quantity}{unit}; grey: never visited.</figcaption></figure>\n",
        title = escape(&map.title),
        y_title = escape(&map.y.title()),
        x_title = escape(&map.x.title()),
        caption = escape(&map.caption),
        quantity = escape(&map.quantity),
        unit = if map.unit.is_empty() { String::new() } else { format!(" in {}", escape(&map.unit)) },
        scale = colour_scale(map.scale, limit),
    )
}

/// The colour scale: steps of opacity between its ends, with numbers.
fn colour_scale(scale: HeatScale, limit: f64) -> String {
    let (low, high) = match scale {
        HeatScale::Diverging => (-limit, limit),
        HeatScale::Sequential => (0.0, limit),
    };
    let step = HEIGHT / SCALE_STEPS as f64;
    let mut drawn = format!("<path class=\"known\" d=\"M{SCALE_LEFT} {TOP}h{SCALE_WIDTH}v{HEIGHT}h-{SCALE_WIDTH}z\"/>");
    for idx in 0..SCALE_STEPS {
        let value = low + (high - low) * (idx as f64 + 0.5) / SCALE_STEPS as f64;
        drawn += &format!(
            "<rect class=\"{}\" x=\"{SCALE_LEFT}\" y=\"{:.2}\" width=\"{SCALE_WIDTH}\" height=\"{:.2}\" fill-opacity=\"{:.2}\"/>",
            hue(value),
            TOP + HEIGHT - step * (idx + 1) as f64,
            step + 0.3,
            value.abs() / limit
        );
    }
    for (value, y) in [(high, TOP + 5.0), (0.5 * (low + high), TOP + 0.5 * HEIGHT + 5.0), (low, TOP + HEIGHT)] {
        drawn += &format!("<text x=\"{}\" y=\"{y:.1}\">{}</text>", SCALE_LEFT + SCALE_WIDTH + 6.0, three_digits(value));
    }
    drawn
}

fn hue(value: f64) -> &'static str {
    if value < 0.0 { "cold" } else { "warm" }
}

fn four_units(value: f64, axis: &Axis) -> String {
    match axis.unit() {
        "" => three_digits(value),
        unit => format!("{} {unit}", three_digits(value)),
    }
}

/// Magnitude at the end of the scale: that which 98 % of the cells stay below.
fn limit(values: &[f64]) -> f64 {
    let mut magnitudes: Vec<f64> = values.iter().filter(|value| value.is_finite()).map(|value| value.abs()).collect();
    magnitudes.sort_by(f64::total_cmp);
    let place = (magnitudes.len().saturating_sub(1) as f64 * COVER).ceil() as usize;
    magnitudes.get(place).copied().filter(|&limit| limit > 0.0).unwrap_or(1.0)
}

/// Ticks and their places (0 to 1) on an axis of bins drawn equally wide.
fn tick_places(edges: &[f64]) -> Vec<(f64, f64)> {
    let n_bins = edges.len().saturating_sub(1);
    let (Some(&low), Some(&high)) = (edges.first(), edges.last()) else {
        return Vec::new();
    };
    if n_bins == 0 || !high.is_finite() || !low.is_finite() || high <= low {
        return Vec::new();
    }
    let is_even = edges.windows(2).all(|pair| ((pair[1] - pair[0]) * n_bins as f64 / (high - low) - 1.0).abs() < 1e-6);
    let values: Vec<f64> = if is_even {
        let rough = (high - low) / 5.0;
        let power = 10f64.powf(rough.log10().floor());
        let step =
            [1.0, 2.0, 5.0, 10.0].map(|digit| digit * power).into_iter().find(|&step| step >= rough).unwrap_or(rough);
        let first = (low / step - 1e-9).ceil() as i64;
        (first..).map(|k| k as f64 * step).take_while(|&value| value <= high + 1e-9 * step).collect()
    } else {
        // An uneven axis has its ticks at every fourth part, at values of two digits.
        (0..=8).map(|part| edges[n_bins * part / 8]).map(|edge| format!("{edge:.1e}").parse().unwrap_or(edge)).collect()
    };
    values.into_iter().filter_map(|value| Some((value, place(edges, value)?))).collect()
}

/// Where `value` lies on the axis; none beyond its ends by more than half a bin.
fn place(edges: &[f64], value: f64) -> Option<f64> {
    let n_bins = edges.len() - 1;
    let bin = edges.partition_point(|&edge| edge <= value).clamp(1, n_bins) - 1;
    let within = (value - edges[bin]) / (edges[bin + 1] - edges[bin]);
    (-0.5..=1.5).contains(&within).then(|| ((bin as f64 + within) / n_bins as f64).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn even_axes_have_round_ticks_and_uneven_ones_stand_where_they_say() {
        let even: Vec<f64> = (0..=24).map(|k| -60.0 + 5.0 * f64::from(k)).collect();
        let values: Vec<f64> = tick_places(&even).iter().map(|tick| tick.0).collect();
        assert_eq!(values, [-50.0, 0.0, 50.0]);
        let uneven: Vec<f64> = (-12_i32..=12).map(|k| f64::from(k * k.abs()) / 144.0 * 376.99).collect();
        for (value, place) in tick_places(&uneven) {
            let s = 2.0 * place - 1.0;
            // Linear within a bin of a twelfth: off from the parabola by (1/24)^2 at most.
            assert!((s * s.abs() - value / 376.99).abs() < 0.02, "{value} at {place}");
        }
        assert_eq!(tick_places(&[]), []);
        assert_eq!(tick_places(&[1.0, 1.0]), []);
    }

    #[test]
    fn a_single_wild_cell_does_not_wash_the_map_out() {
        let mut values = vec![1.0; 576];
        values[7] = 1000.0;
        values[8] = f64::NAN;
        assert_eq!(limit(&values), 1.0);
        assert_eq!(limit(&[f64::NAN]), 1.0);
        assert_eq!(limit(&[0.0, -3.0]), 3.0);
    }
}
