//! Boots an image with a relaxed thesis plant and prints what it does. `cargo run -p virtual-board --example boot -- IMAGE.elf`

use control_core::{Calibration, CalibrationSettings};
use plant_sim::model::Model;
use plant_sim::replay::Start;
use std::path::Path;
use virtual_board::{Bench, BenchSettings, Chip, Image, Machine};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("give the image")?;
    let image = Image::read(Path::new(&path))?;
    let chain = Model::read(Path::new("models/thesis-phs.toml"))?.chain();
    let start = Start::relaxed(&chain);
    let calibration = Calibration::try_build(&CalibrationSettings::NUCLEO_G474RE)?;
    let settings = BenchSettings { chain, start, calibration, seed: 1, anti_alias_hz: None };
    let mut machine = Machine::new(&image, Chip::new(Bench::new(&settings, 1700)));
    let started = std::time::Instant::now();
    machine.run(170_000_000, |chip| chip.samples >= 10000)?;
    let cost = machine.cost();
    println!("{} cycles, {} instructions, {:?}", machine.now(), machine.instructions(), started.elapsed());
    println!("control interrupt: {cost:?}");
    for row in machine.chip().rows.iter().take(4) {
        println!("{row:?}");
    }
    Ok(())
}
