//! Every number of the thesis against its print: `hysteron reproduce` may leave none unexplained.
//!
//! The closed-loop table is that of a general stiff solver (LSODA, relative tolerance 1e-8) with the controller in continuous time,
//! 120 um. Ours run the board's law at 1 MHz without delay. A step is judged over 20 ms, a sine over its third period.

use gap_diagnosis::reproduce::{Entry, Reproduction, Thesis, Verdict, half_digit, reproduce, value};
use std::sync::LazyLock;

static FOUND: LazyLock<Reproduction> = LazyLock::new(|| reproduce(&Thesis::default(), &|_| {}));

fn line(entry: &Entry) -> String {
    format!("{}, {}: printed {}, ours {:?}", entry.place, entry.what, entry.printed, entry.ours)
}

fn chapter(heading: &str) -> &'static [Entry] {
    let found = FOUND.chapters.iter().find(|chapter| chapter.heading.starts_with(heading));
    &found.expect("a chapter of the report").entries
}

#[test]
fn no_number_is_left_unexplained() {
    let differ: Vec<String> = FOUND.entries().filter(|e| e.verdict == Verdict::Differs).map(line).collect();
    assert!(differ.is_empty(), "\n{}", differ.join("\n"));
    let count = |is: fn(&Verdict) -> bool| FOUND.count(is);
    // A verdict that no entry gets any more is a lost chapter.
    assert!(count(|v| *v == Verdict::Agrees) >= 70);
    assert_eq!(count(|v| *v == Verdict::Within), 90);
    assert!(count(|v| *v == Verdict::Given) == 7);
}

#[test]
fn the_errata_hold_their_corrected_values() {
    let errata = [
        ("(3.9)", "22018"),
        ("(3.10)", "-20856"),
        ("(3.10)", "-1161.3"),
        ("(3.13)", "-18765"),
        ("(3.13)", "-2166"),
        ("(3.13)", "-1086.5"),
        ("(3.24)", "0"),
        ("(3.6)", "4.52"),
        ("3.1.2", "0.37"),
        ("(3.29)", "638.5"),
        ("(3.31)", "1.0637e6"),
    ];
    let found: Vec<(&str, &str, f64)> = FOUND
        .entries()
        .filter_map(|entry| match &entry.verdict {
            Verdict::Erratum { corrected, cause } => {
                assert!(cause.len() > 20, "{}", line(entry));
                Some((entry.place.as_str(), corrected.as_str(), entry.ours))
            }
            _ => None,
        })
        .collect();
    assert_eq!(found.len(), errata.len(), "{found:?}");
    for (place, corrected) in errata {
        let ours = found.iter().find(|(p, c, _)| *p == place && *c == corrected);
        let ours = ours.unwrap_or_else(|| panic!("{place} {corrected}: {found:?}")).2;
        assert!((ours - value(corrected)).abs() <= half_digit(corrected), "{place}: {ours}");
    }
}

#[test]
fn every_number_of_the_loops_comes_out() {
    let entries = chapter("Closed loops");
    // 6 loops of 3 step figures and 4 sines of 3 figures.
    assert_eq!(entries.len(), 90);
    // Gains: 0.002; the rest the larger of 1 % and half a unit of the last digit.
    let of_bound = |entry: &Entry| {
        let allowed = match entry.unit {
            "" => 0.002,
            _ => half_digit(&entry.printed).max(0.01 * value(&entry.printed).abs()),
        };
        (entry.ours - value(&entry.printed)).abs() / (allowed * (1.0 + 1e-9))
    };
    let mut worst = 0.0f64;
    for entry in entries {
        let share = of_bound(entry);
        assert!(share <= 1.0, "{}: {:.0} % of what is allowed", line(entry), 100.0 * share);
        worst = worst.max(share);
    }
    // Nor would agreement of every number to a tenth of its printed digits be believable: the two solvers differ in the controller.
    assert!(worst > 0.1, "{worst}");
}

#[test]
fn bouc_wen_falls_behind_as_table_2_3_says() {
    let trend = &FOUND.trend;
    assert!(trend.falls_steadily(), "{:?}", trend.fit_percent);
    // Measured 97.36 % at 1 Hz and 82.91 % at 150 Hz: both sides bounded, so that neither model can be swapped for the other.
    let ends = [trend.fit_percent[0], trend.fit_percent[6]];
    assert!((97.0..97.8).contains(&ends[0]) && (82.0..84.0).contains(&ends[1]), "{ends:?}");
}
