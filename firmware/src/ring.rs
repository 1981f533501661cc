//! A lock-free queue from one side to another: the control interrupt is one of them.
//!
//! `heapless::spsc` would do, but its length is known at run time only, which puts a division and a panic into the control interrupt.
//! Here the length is a power of two and part of the type.

use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicU32, Ordering};

/// Holds `N` values, `N` a power of two. One side pushes, one other side pops.
pub struct Ring<T, const N: usize> {
    /// Values popped since the start, modulo 2^32; only the popping side writes it.
    popped: AtomicU32,
    /// Values pushed; only the pushing side writes it.
    pushed: AtomicU32,
    places: [UnsafeCell<MaybeUninit<T>>; N],
}

// SAFETY: a place is written before `pushed` says so and read after (release and acquire), by the two sides that the contracts of
// `push` and `pop` name. `T: Send` because values change sides; `T: Copy` because nothing is dropped.
unsafe impl<T: Send + Copy, const N: usize> Sync for Ring<T, N> {}

impl<T: Copy, const N: usize> Default for Ring<T, N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T: Copy, const N: usize> Ring<T, N> {
    /// Empty.
    pub const fn new() -> Self {
        const { assert!(N.is_power_of_two() && N < 1 << 31) };
        Ring {
            popped: AtomicU32::new(0),
            pushed: AtomicU32::new(0),
            places: [const { UnsafeCell::new(MaybeUninit::uninit()) }; N],
        }
    }

    /// Values in it.
    #[inline(always)]
    pub fn len(&self) -> usize {
        self.pushed.load(Ordering::Acquire).wrapping_sub(self.popped.load(Ordering::Acquire)) as usize
    }

    /// Whether there are none.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Appends a value; false, and nothing done, if it is full.
    ///
    /// # Safety
    ///
    /// Only one side of the program calls this.
    #[inline(always)]
    pub unsafe fn push(&self, value: T) -> bool {
        let pushed = self.pushed.load(Ordering::Relaxed);
        if pushed.wrapping_sub(self.popped.load(Ordering::Acquire)) as usize >= N {
            return false;
        }
        // SAFETY: the popping side does not look at this place until `pushed` counts it.
        unsafe { (*self.places[pushed as usize & (N - 1)].get()).write(value) };
        self.pushed.store(pushed.wrapping_add(1), Ordering::Release);
        true
    }

    /// The oldest value, which stays.
    ///
    /// # Safety
    ///
    /// Only one side of the program calls this or [`Ring::pop`].
    #[inline(always)]
    pub unsafe fn peek(&self) -> Option<T> {
        let popped = self.popped.load(Ordering::Relaxed);
        if popped == self.pushed.load(Ordering::Acquire) {
            return None;
        }
        // SAFETY: `pushed` counts this place, so it was written, and it is not written again before `popped` counts it.
        Some(unsafe { (*self.places[popped as usize & (N - 1)].get()).assume_init() })
    }

    /// Takes the oldest value out.
    ///
    /// # Safety
    ///
    /// Only one side of the program calls this or [`Ring::peek`].
    #[inline(always)]
    pub unsafe fn pop(&self) -> Option<T> {
        // SAFETY: the caller's promise.
        let value = unsafe { self.peek() }?;
        self.popped.store(self.popped.load(Ordering::Relaxed).wrapping_add(1), Ordering::Release);
        Some(value)
    }
}
