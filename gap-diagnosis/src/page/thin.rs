//! Thinning: millions of samples become a few thousand drawn points without hiding a peak or inventing a value.
//!
//! Both functions return indices of true samples, never averages, so the cursor on the page reads what was measured.

/// How the buckets of [`decimate`] lie over the rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Spacing {
    /// Equal numbers of rows, for a time axis.
    Even,
    /// Equal ratios of the row number, for a logarithmic frequency axis: equal buckets would spend nearly all points on the last decade.
    Logarithmic,
}

/// Rows to draw, ascending, at most `n_points` of them (at least 16): per bucket and column the smallest and the largest value,
/// one missing value where there is one (so that gaps stay gaps), and always the first and the last row.
///
/// The columns share their rows, hence a peak in one column keeps that row in all.
///
/// # Panics
/// If the columns differ in length.
pub fn decimate(columns: &[&[f64]], n_points: usize, spacing: Spacing) -> Vec<usize> {
    let n_rows = columns.first().map_or(0, |column| column.len());
    assert!(columns.iter().all(|column| column.len() == n_rows), "columns of one chart have the same number of rows");
    let n_points = n_points.max(16);
    if n_rows <= n_points {
        return (0..n_rows).collect();
    }

    let has_gap = columns.iter().any(|column| column.iter().any(|value| !value.is_finite()));
    let kept_per_bucket = columns.len() * if has_gap { 3 } else { 2 };
    let n_buckets = ((n_points - 2) / kept_per_bucket).max(1);
    let edge = |bucket_idx: usize| -> usize {
        let fraction = bucket_idx as f64 / n_buckets as f64;
        match spacing {
            Spacing::Even => (n_rows as f64 * fraction).round() as usize,
            Spacing::Logarithmic => (n_rows as f64).powf(fraction).round() as usize - usize::from(bucket_idx == 0),
        }
    };

    let mut kept = vec![0, n_rows - 1];
    for bucket_idx in 0..n_buckets {
        let (from, to) = (edge(bucket_idx), edge(bucket_idx + 1).min(n_rows));
        for column in columns {
            keep_extremes(column, from, to, &mut kept);
        }
    }
    kept.sort_unstable();
    kept.dedup();
    kept
}

/// Sample indices that draw the path `(x, y)` of a loop plot; `None` lifts the pen. At most about `n_points` entries.
///
/// A loop run through a thousand times is one loop on paper. Taking every k-th sample would cut across it and hide the hysteresis that
/// the plot is there to show, so the path is drawn on a grid and only strokes that ink a new cell are kept. The grid is as fine as the
/// budget allows (1024 cells per side at first, about one screen pixel each). The samples with the extreme x and y are always kept.
///
/// # Panics
/// If `x` and `y` differ in length.
pub fn thin_path(x: &[f64], y: &[f64], n_points: usize) -> Vec<Option<usize>> {
    assert_eq!(x.len(), y.len(), "a path has as many x as y");
    let mut n_cells = 1024;
    loop {
        let path = ink_once(x, y, n_cells, x.len() > n_points);
        if path.len() <= n_points || n_cells == 32 {
            return path;
        }
        n_cells /= 2;
    }
}

fn keep_extremes(column: &[f64], from: usize, to: usize, kept: &mut Vec<usize>) {
    let mut lowest: Option<usize> = None;
    let mut highest: Option<usize> = None;
    let mut missing: Option<usize> = None;
    for (idx, &value) in column.iter().enumerate().take(to).skip(from) {
        if !value.is_finite() {
            missing.get_or_insert(idx);
            continue;
        }
        if lowest.is_none_or(|other| value < column[other]) {
            lowest = Some(idx);
        }
        if highest.is_none_or(|other| value > column[other]) {
            highest = Some(idx);
        }
    }
    kept.extend([lowest, highest, missing].into_iter().flatten());
}

/// One drawing of the path on a square grid of `n_cells` per side; with `thinning` off every sample is kept.
fn ink_once(x: &[f64], y: &[f64], n_cells: usize, thinning: bool) -> Vec<Option<usize>> {
    let is_drawn = |idx: usize| x[idx].is_finite() && y[idx].is_finite();
    let drawn: Vec<usize> = (0..x.len()).filter(|&idx| is_drawn(idx)).collect();
    let Some(&first) = drawn.first() else {
        return Vec::new();
    };

    let mut extremes = [first; 4];
    for &idx in &drawn {
        for (extreme, is_further) in extremes.iter_mut().zip([
            |values: (f64, f64), other: (f64, f64)| values.0 < other.0,
            |values: (f64, f64), other: (f64, f64)| values.0 > other.0,
            |values: (f64, f64), other: (f64, f64)| values.1 < other.1,
            |values: (f64, f64), other: (f64, f64)| values.1 > other.1,
        ]) {
            if is_further((x[idx], y[idx]), (x[*extreme], y[*extreme])) {
                *extreme = idx;
            }
        }
    }
    let [left, right, bottom, top] = extremes;
    let cell_of = |value: f64, low: f64, high: f64| -> i64 {
        let width = (high - low).max(f64::MIN_POSITIVE);
        ((value - low) / width * (n_cells - 1) as f64).round() as i64
    };
    let cell = |idx: usize| (cell_of(x[idx], x[left], x[right]), cell_of(y[idx], y[bottom], y[top]));

    let mut inked = vec![false; n_cells * n_cells];
    let mut path: Vec<Option<usize>> = Vec::new();
    // The pen rests at `at` (last sample taken into account) and `path` ends with `at` only while it is down.
    let mut at: Option<usize> = None;
    for idx in 0..x.len() {
        if !is_drawn(idx) {
            at = None;
            if path.last().is_some_and(Option::is_some) {
                path.push(None);
            }
            continue;
        }
        let target = cell(idx);
        let must_keep = !thinning || extremes.contains(&idx);
        if let Some(previous) = at
            && cell(previous) == target
            && !must_keep
        {
            continue;
        }
        let from = at.map_or(target, cell);
        let is_new = ink_line(&mut inked, n_cells, from, target);
        if is_new || must_keep {
            let pen = path.last().copied().flatten();
            // Two cells are a line's width: there a straight join is truer than a gap, which would make noise look like dashes.
            let is_near = |other: usize| {
                let (column, row) = cell(other);
                (column - target.0).abs().max((row - target.1).abs()) <= 2
            };
            if at.is_none() || pen != at && !pen.is_some_and(is_near) {
                if pen.is_some() {
                    path.push(None);
                }
                path.extend(at.map(Some));
            }
            path.push(Some(idx));
        }
        at = Some(idx);
    }
    while path.last().is_some_and(Option::is_none) {
        path.pop();
    }
    path
}

/// Inks the straight line between two cells; says whether any of it was blank before.
fn ink_line(inked: &mut [bool], n_cells: usize, from: (i64, i64), to: (i64, i64)) -> bool {
    let n_steps = (to.0 - from.0).abs().max((to.1 - from.1).abs()).max(1);
    let mut is_new = false;
    for step in 0..=n_steps {
        let along = |a: i64, b: i64| a + ((b - a) * step + (b - a).signum() * n_steps / 2) / n_steps;
        let (column, row) = (along(from.0, to.0), along(from.1, to.1));
        let place = row as usize * n_cells + column as usize;
        is_new |= !inked[place];
        inked[place] = true;
    }
    is_new
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_ascending(indices: &[usize]) -> bool {
        indices.windows(2).all(|pair| pair[0] < pair[1])
    }

    #[test]
    fn extremes_of_three_million_samples_survive() {
        let n = 3_000_000;
        let mut first: Vec<f64> = (0..n).map(|k| (f64::from(k) * 1e-4).sin()).collect();
        let mut second = vec![0.0; n as usize];
        // One sample wide, at places that no round stride hits.
        first[1_234_567] = 7.0;
        first[2_999_998] = -9.0;
        second[77_777] = 1e-3;
        let kept = decimate(&[&first, &second], 4000, Spacing::Even);
        assert!(is_ascending(&kept) && kept.len() <= 4000 && kept.len() > 1500, "{}", kept.len());
        for idx in [0, 77_777, 1_234_567, 2_999_998, 2_999_999] {
            assert!(kept.contains(&idx), "{idx}");
        }
    }

    #[test]
    fn every_bucket_keeps_its_own_extremes() {
        // A fast square wave: the envelope must stay full everywhere, not only at the global peak.
        let wave: Vec<f64> = (0..100_000).map(|k| if k % 7 < 3 { 1.0 } else { -1.0 }).collect();
        let kept = decimate(&[&wave], 1000, Spacing::Even);
        for pair in kept[2..kept.len() - 2].chunks_exact(2) {
            assert!(wave[pair[0]] != wave[pair[1]]);
        }
    }

    #[test]
    fn gaps_stay_gaps() {
        let mut column: Vec<f64> = (0..50_000).map(f64::from).collect();
        column[31_313] = f64::NAN;
        column[40_000..41_000].fill(f64::NAN);
        let kept = decimate(&[&column], 500, Spacing::Even);
        assert!(kept.len() <= 500);
        assert!(kept.contains(&31_313));
        assert!(kept.iter().filter(|&&idx| column[idx].is_nan()).count() >= 2);
    }

    #[test]
    fn few_empty_and_missing() {
        assert_eq!(decimate(&[], 100, Spacing::Even), Vec::<usize>::new());
        assert_eq!(decimate(&[&[]], 100, Spacing::Even), Vec::<usize>::new());
        assert_eq!(decimate(&[&[3.0]], 100, Spacing::Logarithmic), vec![0]);
        let missing = vec![f64::NAN; 10_000];
        assert!(decimate(&[&missing], 100, Spacing::Logarithmic).len() <= 100);
    }

    #[test]
    fn logarithmic_buckets_keep_the_first_decades_whole() {
        let spectrum: Vec<f64> = (1..=500_000).map(|k| 1.0 / f64::from(k)).collect();
        let kept = decimate(&[&spectrum], 2000, Spacing::Logarithmic);
        assert!(is_ascending(&kept) && kept.len() <= 2000);
        for idx in 0..50 {
            assert!(kept.contains(&idx), "{idx}");
        }
        assert!(kept.contains(&499_999));
    }

    #[test]
    fn a_loop_run_a_thousand_times_keeps_its_shape() {
        let n = 1_000_000;
        let angle = |k: usize| k as f64 * 0.0063;
        let x: Vec<f64> = (0..n).map(|k| angle(k).cos()).collect();
        let mut y: Vec<f64> = (0..n).map(|k| angle(k).sin()).collect();
        y[654_321] = 3.0;
        let path = thin_path(&x, &y, 12_000);
        assert!(path.len() <= 12_000 && path.len() > 500, "{}", path.len());
        assert!(path.contains(&Some(654_321)));
        // No chord cuts across: strokes join neighbours on the ring. The ring's step is 0.0063; strokes may be longer by a few grid
        // cells (2/1024 each, up to 16 times coarser), save the two to and from the planted peak.
        let n_chords = path
            .windows(2)
            .filter_map(|pair| Some((pair[0]?, pair[1]?)))
            .filter(|&(a, b)| (x[a] - x[b]).hypot(y[a] - y[b]) > 0.15)
            .count();
        assert!(n_chords <= 2, "{n_chords}");
    }

    #[test]
    fn paths_with_gaps_constants_and_nothing() {
        assert!(thin_path(&[], &[], 100).is_empty());
        assert!(thin_path(&[f64::NAN; 9], &[1.0; 9], 100).is_empty());
        assert_eq!(thin_path(&[2.0; 3], &[5.0; 3], 100), vec![Some(0), Some(1), Some(2)]);
        let constant = thin_path(&vec![2.0; 5000], &vec![5.0; 5000], 100);
        assert_eq!(constant, vec![Some(0)]);
        let x = [0.0, 1.0, f64::NAN, 2.0, 3.0];
        assert_eq!(thin_path(&x, &x, 100), vec![Some(0), Some(1), None, Some(3), Some(4)]);
    }

    #[test]
    fn noise_stays_within_the_budget() {
        // A cheap generator (Weyl sequence) is noise enough to fill the plane.
        let x: Vec<f64> = (0..400_000).map(|k| (f64::from(k) * 0.618_034).fract()).collect();
        let y: Vec<f64> = (0..400_000).map(|k| (f64::from(k) * 0.414_213_56).fract()).collect();
        assert!(thin_path(&x, &y, 6000).len() <= 6000);
    }
}
