//! Who holds control: one page at a time, as long as it shows that it is there. Time is an argument.
//!
//! What this does not do: stop anything. Whoever asks learns that a lease has lapsed, and ends the run.

use std::time::Duration;

/// A page's number, never used again.
pub type PageId = u64;

/// Longest silence of the page that holds control. It answers every status, ten a second; the board's own patience with its host is 0.25 s.
pub const LAPSE: Duration = Duration::from_secs(2);

/// Why a page does not get control.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TakeError {
    /// Another page has it.
    #[error("another page holds control: release it there, or close that page")]
    Held,
    /// It has just lapsed, and what this page began is not ended yet.
    #[error("this page was silent for too long and its run is being ended: take control again")]
    Lapsed,
}

/// The lease.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lease {
    holder: Option<(PageId, Duration)>,
}

impl Lease {
    /// Gives control to `page`, unless a page has it. A lapsed holder has it until [`Lease::lapse`] was told: whoever took it
    /// before would keep a run going that a silent page began.
    ///
    /// # Errors
    /// [`TakeError`].
    pub fn take(&mut self, page: PageId, now: Duration) -> Result<(), TakeError> {
        match self.holder {
            Some((holder, _)) if holder != page => Err(TakeError::Held),
            Some((_, heard)) if is_over(heard, now) => Err(TakeError::Lapsed),
            _ => {
                self.holder = Some((page, now));
                Ok(())
            }
        }
    }

    /// `page` is still there. Once it was silent for too long, that is too late.
    pub fn beat(&mut self, page: PageId, now: Duration) {
        if let Some((holder, heard)) = &mut self.holder
            && *holder == page
            && !is_over(*heard, now)
        {
            *heard = now;
        }
    }

    /// Takes control from `page`; whether it had it.
    pub fn release(&mut self, page: PageId) -> bool {
        let had = self.is_held_by(page);
        if had {
            self.holder = None;
        }
        had
    }

    /// Whether control has just lapsed; says so once.
    pub fn lapse(&mut self, now: Duration) -> bool {
        let lapsed = self.holder.is_some_and(|(_, heard)| is_over(heard, now));
        if lapsed {
            self.holder = None;
        }
        lapsed
    }

    /// Whether `page` has control.
    pub fn is_held_by(&self, page: PageId) -> bool {
        self.holder().is_some_and(|holder| holder == page)
    }

    /// The page that has control.
    pub fn holder(&self) -> Option<PageId> {
        self.holder.map(|(page, _)| page)
    }
}

fn is_over(heard: Duration, now: Duration) -> bool {
    now.saturating_sub(heard) > LAPSE
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: Duration = Duration::from_secs(1);

    #[test]
    fn one_page_holds_control_and_another_gets_it_after_release() {
        let mut lease = Lease::default();
        assert_eq!((lease.take(1, S), lease.take(2, S), lease.take(1, S)), (Ok(()), Err(TakeError::Held), Ok(())));
        assert!(!lease.release(2));
        assert!(lease.release(1));
        assert_eq!((lease.take(2, S), lease.holder()), (Ok(()), Some(2)));
    }

    #[test]
    fn a_heartbeat_of_the_holder_keeps_it_and_no_other_does() {
        let mut lease = Lease::default();
        lease.take(1, S).unwrap();
        lease.beat(1, 3 * S);
        lease.beat(2, 9 * S);
        assert!(!lease.lapse(5 * S), "two seconds are allowed");
        assert!(lease.lapse(5 * S + Duration::from_millis(1)));
        assert!(!lease.lapse(9 * S), "once");
        assert_eq!(lease.holder(), None);
        lease.beat(1, 9 * S);
        assert_eq!(lease.holder(), None, "a beat takes nothing back");
    }

    #[test]
    fn a_lapsed_lease_is_free_only_after_its_lapse_was_told() {
        let mut lease = Lease::default();
        lease.take(1, S).unwrap();
        let late = 3 * S + Duration::from_millis(1);
        assert_eq!(lease.take(2, late), Err(TakeError::Held));
        // Nor does the silent page come back before its run has ended.
        lease.beat(1, late);
        assert_eq!(lease.take(1, late), Err(TakeError::Lapsed));
        assert!(lease.lapse(late), "whoever runs the bench is told");
        assert_eq!((lease.take(2, late), lease.holder()), (Ok(()), Some(2)));
    }
}
