//! The flash image: what stands between the control law (`control-core`) and the pins of an STM32G474.
//!
//! Time: TIM8 starts the ADC at count 0, which tracks its pin for 190 counts and holds it then; the control interrupt turns the code into a
//! drive and hands it to the DAC; 1700 counts (10 us at 170 MHz) after the hold the same timer latches the DAC in hardware. Nothing masks the control
//! interrupt ([`masks`]), and it shares only lock-free queues and atomics with the rest ([`shared`]).
//!
//! | file | what |
//! | --- | --- |
//! | [`control`] | the control interrupt: one sample |
//! | [`mod@between`] | requests, stream, capture: the interrupt behind it |
//! | [`registers`] | every register that embassy has no driver for |
//! | [`line`](mod@line) | bytes in: a ring behind a DMA that never stops |
//! | [`link`] | frames in, answers and the stream out |
//! | [`start`] | reset cause, clock, order of the first steps, the watchdog's supervisor |
//! | `bin/` | one file per board: its converters and its interrupt |
//!
//! What it does not do: no control law of its own, no floating-point library, no allocation, no time driver: the sample counter is the clock.
#![no_std]

pub mod between;
pub mod capture;
pub mod control;
pub mod external;
pub mod line;
pub mod link;
pub mod masks;
pub mod registers;
pub mod ring;
pub mod shared;
pub mod start;
pub mod store;

use embassy_stm32::pac::Interrupt;
use wire::{Converters, Parameters};

/// One sample as the converters deliver it.
#[derive(Clone, Copy, Debug)]
pub struct Reading {
    /// Displacement, ADC code.
    pub displacement: u16,
    /// Amplifier monitor, ADC code.
    pub monitor: u16,
    /// A sample before this one was overwritten unread.
    pub is_one_lost: bool,
}

/// A board's converters. All of it but `begin` runs in the control interrupt.
pub trait Board {
    /// The board file's name.
    const NAME: &'static str;
    /// Widths, spans and timing.
    const CONVERTERS: Converters;
    /// In force until a host or the flash says otherwise.
    const PARAMETERS: Parameters;
    /// Cycles that a code needs from [`Board::put`] until the DAC can latch it.
    const PUT_CYCLES: u32;
    /// The control interrupt.
    const INTERRUPT: Interrupt;
    /// Sets the converters up, the DAC at the safe level first (an external one has it with the timer's first latch); the timer does not run yet.
    fn begin();
    /// Sets the timer up for them; it does not run yet.
    fn begin_timer(period_cycles: u32);
    /// The sample that has just been converted.
    fn take() -> Reading;
    /// Hands the next drive to the DAC, to be latched by the timer.
    fn put(code: u16);
    /// As [`Board::put`], in place of a code that was put in this sample and came too late.
    fn put_back(code: u16);
    /// The code that the DAC has latched, where it can be asked.
    fn output() -> Option<u16>;
    /// The last act of a program that has lost its way: the DAC at mid-code as soon as it can be. Nothing is on its way when it returns, as a
    /// reset may come next.
    fn make_safe();
}
