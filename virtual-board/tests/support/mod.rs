//! What the tests of the image share: the image itself, built here, and a bench around it.
#![allow(dead_code, reason = "each test program uses a part of it")]

#[path = "../../../tests/support/flash_image.rs"]
mod flash_image;

use control_core::{Calibration, CalibrationSettings};
use plant_sim::model::Model;
use plant_sim::replay::Start;
use std::path::{Path, PathBuf};
use virtual_board::{BenchSettings, Image, VirtualBoard};

pub const PERIOD: u64 = 8500;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the repository's root").to_owned()
}

/// The image, built by `cargo xtask firmware`; `None`, and said so, where there is no compiler for the chip.
pub fn image(board: &str) -> Option<Image> {
    Some(Image::read(&flash_image::folder()?.join(board)).expect("the image that was just built"))
}

pub fn calibration() -> Calibration {
    Calibration::try_build(&CalibrationSettings::NUCLEO_G474RE).expect("sound settings")
}

/// The thesis' plant at rest, without noise.
pub fn bench() -> BenchSettings {
    let chain = Model::read(&root().join("models/thesis-phs.toml")).expect("a model of ours").chain();
    let start = Start::relaxed(&chain);
    BenchSettings {
        chain,
        start,
        calibration: calibration(),
        seed: 1,
        anti_alias_hz: None,
        has_external_converters: false,
    }
}

/// The image on its board, greeted; `None` where it can't be built.
pub fn board() -> Option<VirtualBoard> {
    let mut board = VirtualBoard::new(&image("nucleo-g474re")?, &bench(), 1700);
    board.greet().expect("an identity");
    Some(board)
}

/// The image for external converters of 16 bits, on a board that has them.
pub fn external_board() -> Option<VirtualBoard> {
    let parameters = wire::Parameters::EXTERNAL_PI1;
    let calibration = parameters.check(&wire::Converters::EXTERNAL_16BIT).expect("sound parameters").calibration;
    let settings = BenchSettings { calibration, has_external_converters: true, ..bench() };
    let mut board = VirtualBoard::new(&image("external-16bit")?, &settings, 1700);
    board.greet().expect("an identity");
    Some(board)
}
