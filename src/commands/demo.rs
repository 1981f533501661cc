//! `hysteron` alone.

use crate::failure::Failure;

pub fn demo() -> Result<(), Failure> {
    Ok(())
}
