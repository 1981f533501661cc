//! Model and controller files: those of the project, what is written is read back, and a stated start is where a run begins.

use plant_sim::FileError;
use plant_sim::chain::{Held, Simulator};
use plant_sim::controller::Controller;
use plant_sim::model::{InitialStateSection, Model, SensorSection};
use plant_sim::param::Param;
use std::fs;
use std::path::{Path, PathBuf};

fn of_project(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("hysteron-model-{name}-{}", std::process::id()));
    fs::create_dir_all(&folder).expect("a temporary folder");
    folder
}

/// What docs/files.md shows is what is read: all sections of either kind of file, and every number is assumed that has no source.
#[test]
fn the_files_that_are_explained_are_files() {
    let text = fs::read_to_string(of_project("docs/files.md")).expect("a document of the project");
    let examples: Vec<&str> =
        text.split("```toml\n").skip(1).map(|rest| rest.split("```").next().expect("an end")).collect();
    let [plant, matrices, polynomials, controller] = examples[..] else { panic!("{} examples", examples.len()) };
    let plant_of = |text| Model::parse(text, Path::new("docs/files.md")).unwrap_or_else(|e| panic!("{e}"));
    let ends = [matrices, polynomials].map(|text| {
        let mut plant = Simulator::new(&plant_of(text).chain(), 1e-4, 0.0);
        (0..10).for_each(|_| plant.advance(Held::zero_order(10.0), 0.0));
        plant.reading_m()
    });
    assert!(
        ends[0] > 1e-6 && (ends[0] / ends[1] - 1.0).abs() < 1e-9,
        "matrices and polynomials of one plant: {ends:?}"
    );
    let model = plant_of(plant);
    assert_eq!(model.warnings(), Vec::<String>::new());
    assert!(model.rig.is_some() && model.initial_state.is_some() && model.effects.len() == 1);
    let offset = model.sensor.offset_um.as_ref().expect("a zero");
    assert_eq!((offset.sigma_abs, offset.source.as_str()), (Some(0.5), "set by hand each day"));
    assert_eq!(model.structure.stiffness_n_per_m.source, "assumed");
    assert!(model.drive.quantum_v.is_some() && model.sensor.quantum_um.is_some());
    let controller = Controller::parse(controller, Path::new("docs/files.md")).unwrap_or_else(|e| panic!("{e}"));
    assert!(controller.limits.is_some() && controller.reference.is_some() && controller.guard.is_some());
}

#[test]
fn every_file_of_the_project_is_read_without_a_warning_and_says_where_its_numbers_come_from() {
    for (directory, least) in [("models", 3), ("controllers", 4)] {
        let entries = fs::read_dir(of_project(directory)).expect("a folder of the project");
        let mut files = 0;
        for path in
            entries.map(|entry| entry.expect("an entry").path()).filter(|p| p.extension().is_some_and(|e| e == "toml"))
        {
            let text = fs::read_to_string(&path).expect("a file of the project");
            if directory == "models" {
                let model = Model::read(&path).unwrap_or_else(|e| panic!("{e}"));
                assert_eq!(model.warnings(), Vec::<String>::new(), "{}", path.display());
            } else {
                Controller::read(&path).unwrap_or_else(|e| panic!("{e}"));
            }
            for line in text.lines().filter(|line| line.contains("value =")) {
                assert!(line.contains("source = \""), "{}: {line}", path.display());
            }
            files += 1;
        }
        assert!(files >= least, "{directory}");
    }
}

#[test]
fn what_is_written_is_read_back_to_the_bit() {
    let folder = folder("write");
    let mut model = Model::read(&of_project("models/thesis-phs.toml")).expect("of the project");
    model.structure.mass_kg = Param::new(0.1 + 0.2, 1.0 / 3.0, "a \"quoted\" source, with a line\nbreak");
    model.sensor = SensorSection { offset_um: Some(Param::absolute(-1.5, 0.02, "fit")), ..SensorSection::default() };
    model.initial_state = Some(InitialStateSection {
        displacement_um: 12.5,
        velocity_um_per_s: -3e3,
        hysteron_v: vec![7.25, -4.3],
        drive_v: 11.0,
    });
    let path = folder.join("m.toml");
    fs::write(&path, "of an earlier run").expect("a file there");
    model.write(&path).expect("room on the disk");
    assert_eq!(Model::read(&path).expect("our own file"), model);
    // Nothing is left beside it, and a link stays a link.
    let link = folder.join("link.toml");
    std::os::unix::fs::symlink("m.toml", &link).expect("a link");
    model.name = "through the link".into();
    model.write(&link).expect("room on the disk");
    assert!(link.symlink_metadata().expect("it is there").is_symlink());
    assert_eq!(Model::read(&path).expect("our own file").name, "through the link");
    assert_eq!(fs::read_dir(&folder).expect("ours").count(), 2);

    // A stated start is where a run begins: displacement as it is, plus the sensor's offset.
    let chain = model.chain();
    let start = model.start();
    let mut simulator = Simulator::new(&chain, 1e-4, 0.0);
    simulator.start_from(&start.state, start.drive_v);
    assert!((simulator.reading_m() - 11e-6).abs() < 1e-20);
    assert_eq!(simulator.state().hysteron_v, [7.25, -4.3]);
    assert_eq!(start.drive_v, 11.0);
    fs::remove_dir_all(&folder).expect("ours");
}

#[test]
fn writing_into_nowhere_is_an_error_and_leaves_nothing() {
    let folder = folder("nowhere");
    let model = Model::read(&of_project("models/thesis-phs.toml")).expect("of the project");
    for path in [folder.join("no/m.toml"), folder.clone(), PathBuf::from("/dev/full")] {
        let error = model.write(&path).expect_err("it can't be written");
        assert!(matches!(error, FileError::Unwritable { .. }), "{error}");
        assert!(!error.to_string().contains('\n'));
    }
    // The device is still one: a file of that name would have taken its place.
    use std::os::unix::fs::FileTypeExt;
    assert!(fs::metadata("/dev/full").expect("it is there").file_type().is_char_device());
    assert_eq!(fs::read_dir(&folder).expect("ours").count(), 0);
    fs::remove_dir_all(&folder).expect("ours");
}

#[test]
fn uncertainty_is_relative_however_it_is_stated() {
    assert_eq!(Param::new(4.0, 0.1, "").relative_sigma(), 0.1);
    assert_eq!(Param::absolute(-4.0, 0.2, "").relative_sigma(), 0.05);
    // Nothing is relative to zero: the assumed 2 %.
    assert_eq!(Param::absolute(0.0, 0.2, "").relative_sigma(), 0.02);
    assert_eq!(Param::assumed(4.0).relative_sigma(), 0.02);
    assert_eq!(Param::absolute(-4.0, 0.2, "").relative_sigma_or(0.005), 0.05);
    assert_eq!(Param::absolute(0.0, 0.2, "").relative_sigma_or(0.005), 0.005);
}
