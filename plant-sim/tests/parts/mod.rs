//! Every part of the chain against an independent integration at 20 kHz and 60 V: steps, sines, and rest; and whether a search can
//! differentiate by every part's parameter.

mod accuracy;
mod balance;
mod derivative;
mod rival;
