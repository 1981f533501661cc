//! Critical sections that never mask the control interrupt.
//!
//! The usual one (PRIMASK) would delay a sample whenever embassy guards a queue. This one raises BASEPRI, which holds back
//! priorities 1 to 15 and leaves 0, the control interrupt's, alone. In turn that interrupt may use nothing that relies on a critical section:
//! no waker, no channel, no defmt.

use critical_section::{Impl, RawRestoreState, set_impl};

/// The chip has four priority bits, in the upper half of the byte: everything from 1 on.
const FROM_PRIORITY_1: u8 = 1 << 4;

struct BasePriority;

set_impl!(BasePriority);

// SAFETY: between acquire and release no interrupt of priority 1 to 15 is taken, and the one of priority 0 takes no part (see above),
// so that whoever holds the section is alone on this single core.
unsafe impl Impl for BasePriority {
    unsafe fn acquire() -> RawRestoreState {
        let before = cortex_m::register::basepri::read();
        // SAFETY: only raises the mask: never below what an outer section has set, because there is but one level.
        unsafe { cortex_m::register::basepri::write(FROM_PRIORITY_1) };
        before
    }

    unsafe fn release(before: RawRestoreState) {
        // SAFETY: the value that `acquire` found.
        unsafe { cortex_m::register::basepri::write(before) };
    }
}
