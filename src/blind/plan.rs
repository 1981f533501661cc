//! Which cases there are: a list that follows from the order alone, shuffled, with identifiers that tell nothing.

use super::store::sha256;
use blind_truth::{EffectId, ForeignKind, Request, Size, Split, Subject};
use rand::seq::{IndexedRandom, SliceRandom};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// Cases of one scale: of each entry, without effect, with two, of each foreign kind.
const SINGLES: usize = 12;
const NULLS: usize = 200;
const PAIRS: usize = 60;
const FOREIGN: usize = 10;
/// The same in all for a quick run: 40 cases, and one of each foreign kind.
const QUICK: [usize; 3] = [20, 8, 4];

/// No pair holds two of one line: together they are, up to a factor or an order, one motion (thesis.md section 1; lags in
/// series may change places; what only scatters hides behind what scatters more).
const ALIKE: [&[EffectId]; 3] = [
    &[EffectId::PayloadMass, EffectId::AmplifierGain, EffectId::SensorGain, EffectId::ParameterError],
    &[EffectId::TransportDelay, EffectId::AmplifierBandwidth, EffectId::SensorBandwidth],
    &[EffectId::SamplingJitter, EffectId::LostSamples, EffectId::NoiseExcess, EffectId::Quantisation],
];

/// What was ordered: everything follows from it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Order {
    /// Seed of the list and of every case.
    pub seed: u64,
    /// `develop`, `calibrate` or `report`.
    pub split: String,
    /// `short` or `full`.
    pub size: String,
    /// Multiplies the number of cases.
    pub scale: u32,
    /// Forty cases of all kinds instead.
    pub quick: bool,
    /// Only so many cases from the top of the list.
    pub first: Option<usize>,
}

/// A case and its answer, which is sealed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Label {
    /// Name of its folder.
    pub id: String,
    /// Seed of the case.
    pub seed: u64,
    /// `null`, identifiers joined by +, or `foreign:` and a kind.
    pub subject: String,
}

/// The split of a name.
pub fn split(name: &str) -> Result<Split, String> {
    let all = [Split::Develop, Split::Calibrate, Split::Report];
    all.into_iter().find(|split| split.id() == name).ok_or_else(|| "one of develop, calibrate, report".into())
}

/// The size of a name.
pub fn size(name: &str) -> Result<Size, String> {
    match name {
        "short" => Ok(Size::Short),
        "full" => Ok(Size::Full),
        _ => Err("short or full".into()),
    }
}

impl Order {
    /// All labels, in the order in which they are run.
    ///
    /// # Errors
    /// If the split or the size has no meaning, which a file edited by hand may bring about.
    pub fn labels(&self) -> Result<Vec<Label>, String> {
        let split = split(&self.split)?;
        size(&self.size)?;
        let digest = |what: &str, at: usize| sha256(format!("{what} {} {} {at}", self.seed, self.split).as_bytes());
        let number = |hex: &str| u64::from_str_radix(&hex[..16], 16).unwrap_or_default();
        let mut random = Pcg64::seed_from_u64(number(&digest("list", 0)));
        let mut subjects = self.subjects(&mut random);
        subjects.shuffle(&mut random);
        let label = |(at, subject): (usize, String)| Label {
            id: digest("id", at)[..12].to_owned(),
            // The last two bits are the split's, so that no seed belongs to two splits.
            seed: number(&digest("case", at)) & !3 | split as u64,
            subject,
        };
        let labels = subjects.into_iter().enumerate().map(label);
        Ok(labels.take(self.first.unwrap_or(usize::MAX)).collect())
    }

    fn subjects(&self, random: &mut Pcg64) -> Vec<String> {
        let times = |count: usize| count * self.scale.max(1) as usize;
        let all: Vec<EffectId> = EffectId::all().collect();
        let (singles, nulls, pairs, foreign): (Vec<EffectId>, _, _, _) = if self.quick {
            (all.sample(random, QUICK[0]).copied().collect(), QUICK[1], QUICK[2], 1)
        } else {
            let singles = all.iter().flat_map(|effect| std::iter::repeat_n(*effect, times(SINGLES))).collect();
            (singles, times(NULLS), times(PAIRS), times(FOREIGN))
        };
        let mut subjects: Vec<String> = singles.iter().map(|effect| effect.id().to_owned()).collect();
        subjects.extend(std::iter::repeat_n("null".to_owned(), nulls));
        subjects.extend((0..pairs).map(|_| pair(&all, random)));
        let kinds = ForeignKind::ALL.iter().flat_map(|kind| std::iter::repeat_n(kind, foreign));
        subjects.extend(kinds.map(|kind| format!("foreign:{}", kind.id())));
        subjects
    }
}

/// Two effects that don't hide one another.
fn pair(all: &[EffectId], random: &mut Pcg64) -> String {
    loop {
        let (a, b) = (all[random.random_range(0..all.len())], all[random.random_range(0..all.len())]);
        let is_alike = ALIKE.iter().any(|group| group.contains(&a) && group.contains(&b));
        if a != b && !is_alike {
            return format!("{}+{}", a.id(), b.id());
        }
    }
}

impl Label {
    /// The request that makes the case.
    ///
    /// # Errors
    /// If the subject has no meaning.
    pub fn request(&self, order: &Order) -> Result<Request, String> {
        let unknown = |what: &str| format!("{what:?} is no subject of a case");
        let subject = if self.subject == "null" {
            Subject::Null
        } else if let Some(kind) = self.subject.strip_prefix("foreign:") {
            Subject::Foreign(ForeignKind::from_id(kind).ok_or_else(|| unknown(kind))?)
        } else {
            let effect = |id: &str| EffectId::from_id(id).ok_or_else(|| unknown(id));
            Subject::Effects(self.subject.split('+').map(effect).collect::<Result<_, _>>()?)
        };
        Ok(Request { seed: self.seed, subject, split: split(&order.split)?, size: size(&order.size)?, strength: None })
    }

    /// The single effect that it holds, if it does.
    pub fn single(&self) -> Option<&str> {
        EffectId::from_id(&self.subject).map(EffectId::id)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::{BTreeMap, BTreeSet};

    fn order(seed: u64, split: &str) -> Order {
        Order { seed, split: split.into(), size: "short".into(), scale: 1, quick: false, first: None }
    }

    fn kinds(labels: &[Label]) -> [usize; 4] {
        let count = |is: fn(&str) -> bool| labels.iter().filter(|label| is(&label.subject)).count();
        [
            count(|s| EffectId::from_id(s).is_some()),
            count(|s| s == "null"),
            count(|s| s.contains('+')),
            count(|s| s.starts_with("foreign:")),
        ]
    }

    #[test]
    fn a_list_has_what_the_issue_asks_for_and_scale_multiplies_it() {
        let labels = order(1, "develop").labels().unwrap();
        assert_eq!(kinds(&labels), [31 * 12, 200, 60, 80]);
        let mut times: BTreeMap<&str, usize> = BTreeMap::new();
        labels.iter().for_each(|label| *times.entry(&label.subject).or_default() += 1);
        assert!(EffectId::all().all(|effect| times[effect.id()] == 12));
        assert!(ForeignKind::ALL.iter().all(|kind| times[format!("foreign:{}", kind.id()).as_str()] == 10));
        let twice = Order { scale: 2, ..order(1, "develop") }.labels().unwrap();
        assert_eq!(kinds(&twice), [31 * 24, 400, 120, 160]);
        let quick = Order { quick: true, ..order(1, "develop") }.labels().unwrap();
        assert_eq!(kinds(&quick), [20, 8, 4, 8]);
    }

    #[test]
    fn an_order_makes_one_list_and_every_label_a_request() {
        let order = order(5, "calibrate");
        let labels = order.labels().unwrap();
        assert_eq!(labels, order.labels().unwrap());
        assert_ne!(labels, Order { seed: 6, ..order.clone() }.labels().unwrap());
        assert_eq!(Order { first: Some(9), ..order.clone() }.labels().unwrap(), labels[..9]);
        assert!(labels.iter().all(|label| label.request(&order).is_ok_and(|r| r.split == Split::Calibrate)));
    }

    #[test]
    fn splits_never_share_a_seed() {
        let mut seen = BTreeSet::new();
        for split in ["develop", "calibrate", "report"] {
            for seed in 0..5 {
                let labels = order(seed, split).labels().unwrap();
                assert!(labels.iter().all(|label| label.seed % 4 == self::split(split).unwrap() as u64));
                assert!(labels.iter().all(|label| seen.insert(label.seed)), "{split} {seed}");
            }
        }
    }

    #[test]
    fn an_identifier_depends_on_the_place_and_not_on_the_subject() {
        let (full, quick) = (order(3, "report"), Order { quick: true, ..order(3, "report") });
        let (full, quick) = (full.labels().unwrap(), quick.labels().unwrap());
        // At one place of the list, whatever is there, stands one identifier.
        assert!(full.iter().zip(&quick).all(|(a, b)| a.id == b.id && a.seed == b.seed));
        assert!(full.iter().zip(&quick).any(|(a, b)| a.subject != b.subject));
        let ids: BTreeSet<&str> = full.iter().map(|label| label.id.as_str()).collect();
        assert_eq!(ids.len(), full.len());
        // Nor does the order of identifiers, as a listing of the folder shows it, sort by subject.
        let mut sorted: Vec<&Label> = full.iter().collect();
        sorted.sort_by(|a, b| a.id.cmp(&b.id));
        let runs = sorted.windows(2).filter(|pair| (pair[0].subject == "null") == (pair[1].subject == "null")).count();
        // Two neighbours are both null or both not with probability 0.6: 426 of 711, standard deviation 13.
        assert!((370..480).contains(&runs), "{runs}");
    }

    #[test]
    fn no_pair_hides_one_of_its_own() {
        for label in order(2, "develop").labels().unwrap().iter().filter(|label| label.subject.contains('+')) {
            let effects: Vec<EffectId> = label.subject.split('+').filter_map(EffectId::from_id).collect();
            assert!(effects.len() == 2 && effects[0] != effects[1], "{}", label.subject);
            assert!(ALIKE.iter().all(|group| effects.iter().filter(|effect| group.contains(effect)).count() < 2));
        }
    }
}
