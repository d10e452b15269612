//! Brains: that of a scenario, and one of a cell of one's own, which is made without any scenario.

use std::{
    path::{Path, PathBuf},
    sync::{Arc, Mutex},
};

use catch_body::{InputError, TriangleMesh};
use catch_bot::{CatchingBot, Preparation};
use catch_cell::{Brain as _, CameraModel, KnownObject, ObjectFigures, ReferenceScan, reference_scan, rig_from_toml};
use catch_lab::{
    assets::Kind,
    recording,
    scenario::{
        Scenario,
        setup::{DEFAULT_SCENARIO, Setup},
    },
    trial::{StateSnapshot, stopwatch::Stopwatch},
};
use catch_recording::{
    EXTENSION, RecordedCell, brain::BrainSettings, cell_recorder::CellRecorder, name_of, reach_map,
    sources::check_waits_clear,
};
use nalgebra::Point3;
use pyo3::{
    exceptions::{PyOSError, PyRuntimeError},
    prelude::*,
};

use crate::{
    arguments::{
        Named, Numbers, Whole, fault, input_fault, instance, interruptible, list, locked, toml_text, type_fault,
    },
    camera::Camera,
    command::Command,
    equipment::{Gripper, Robot, asset},
    flight::Flight,
    observation::{DepthFrame, Observation},
};

/// A brain, which has seen nothing yet when it is made.
#[pyclass(frozen, module = "catchingbot")]
pub struct Brain {
    brain: Mutex<(Box<CatchingBot>, Stopwatch)>,
    dof: usize,
    cameras: Vec<CameraModel>,
    origin: Origin,
}

/// Origin of the brain.
enum Origin {
    /// A scenario, for throw number `.2` of seed `.1`.
    Setup(Arc<Setup>, u64, u64),
    /// Parts.
    Cell(Box<RecordedCell>),
}

impl Brain {
    /// Creates the brain of a scenario.
    pub fn of_setup(setup: &Arc<Setup>, seed: u64, index: u64) -> Self {
        let brain = Mutex::new((Box::new(setup.brain(seed, index)), Stopwatch::default()));
        let origin = Origin::Setup(setup.clone(), seed, index);
        Self { brain, dof: setup.robot.dof(), cameras: setup.cameras.clone(), origin }
    }

    /// Returns the cell for a recording.
    fn recorded(&self) -> RecordedCell {
        match &self.origin {
            Origin::Setup(setup, seed, index) => recording::cell(setup, *seed, *index),
            Origin::Cell(cell) => (**cell).clone(),
        }
    }

    fn with<T: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut CatchingBot, &mut Stopwatch) -> T + Send) -> T {
        py.detach(|| {
            let (brain, stopwatch) = &mut *locked(&self.brain);
            work(brain, stopwatch)
        })
    }

    /// Checks that an observation can be of this brain's cell.
    fn check(&self, observation: &Observation) -> PyResult<()> {
        if observation.dof != self.dof {
            let found = format!("an arm of {} joints", observation.dof);
            return Err(fault("observation", found, format!("one of {}", self.dof)));
        }
        for frame in &observation.sensed.frames {
            let Some(camera) = self.cameras.get(frame.camera) else {
                let found = format!("an image of camera {}", frame.camera);
                return Err(fault("observation", found, format!("one of {} cameras", self.cameras.len())));
            };
            let window = frame.window;
            if window.area() > 0 && window.intersection(&camera.full_window()) != window {
                let size = format!("one within its {} by {} pixels", camera.width_px, camera.height_px);
                return Err(fault("observation", format!("{window:?} of camera {}", frame.camera), size));
            }
        }
        Ok(())
    }
}

#[pymethods]
impl Brain {
    /// The brain of a cell of one's own. `object` is the name or file of an object, its surface (vertices n×3
    /// in metres, faces m×3), or a scan of it from all around: a list of cameras and a list of their masked
    /// images. `known` are figures of it, such as `mass_kg`; `config` are settings, such as
    /// `control.expected_latency_s`.
    #[new]
    #[pyo3(
        signature = (robot, gripper, cameras, object, *, known=None, config=None, seed=Whole::Default(0)),
        text_signature = "(robot, gripper, cameras, object, *, known=None, config=None, seed=0)"
    )]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn new(
        py: Python<'_>,
        robot: &Robot,
        gripper: &Gripper,
        cameras: &Bound<'_, PyAny>,
        object: &Bound<'_, PyAny>,
        known: Option<&Bound<'_, PyAny>>,
        config: Option<&Bound<'_, PyAny>>,
        seed: Whole,
    ) -> PyResult<Self> {
        let cameras = camera_list("cameras", cameras)?;
        let object = known_object(object, known)?;
        let seed = seed.checked(py, "seed", 0, crate::arguments::MOST)?;
        let settings: BrainSettings =
            InputError::parse_toml("config", &toml_text("config", config)?).map_err(input_fault)?;
        let hand = gripper.model.clone();
        let arm = robot.model.clone().with_mount_of(&hand);
        check_waits_clear(&arm, &hand, "workcell").map_err(input_fault)?;
        let cell = RecordedCell {
            seed,
            brain: settings.given(&object.figures, &cameras),
            sources: robot.sources(gripper),
            ready_rad: robot.model.ready_q.as_slice()[..robot.model.dof()].to_vec(),
            cameras: cameras.clone(),
            reference_scan: object.scan,
        };
        let dof = arm.dof();
        let prepared = interruptible(py, move || {
            let map = reach_map::of(&arm);
            let (config, cameras) = (cell.brain.config(), cell.cameras.clone());
            let known = Preparation::new(config, (arm, map), hand, cameras, &cell.reference_scan)?;
            Ok((cell.brain.brain(Arc::new(known), cell.seed), cell))
        })?;
        let (brain, cell) = prepared.map_err(input_fault)?;
        let brain = Mutex::new((Box::new(brain), Stopwatch::default()));
        Ok(Self { brain, dof, cameras, origin: Origin::Cell(Box::new(cell)) })
    }

    /// One decision about what was sensed.
    fn tick(&self, py: Python<'_>, observation: &Bound<'_, PyAny>) -> PyResult<Command> {
        let observation: &Observation = instance("observation", observation, "an Observation")?;
        self.check(observation)?;
        let sensed = &observation.sensed;
        Ok(self.with(py, |brain, stopwatch| {
            stopwatch.start();
            let command = brain.tick(sensed, stopwatch);
            stopwatch.stop();
            let report = Some(brain.report().clone());
            let snapshot = StateSnapshot { time_s: sensed.time_s, report, stage_ms: stopwatch.last_tick_ms() };
            Command { sent: command, snapshot: Some(Arc::new(snapshot)), dof: self.dof }
        }))
    }

    /// Forgets all that was seen and decided.
    fn reset(&self, py: Python<'_>) {
        self.with(py, |brain, _| brain.reset());
    }

    /// Status of the last tick, such as `no_object`, `planned` or `committed`.
    #[getter]
    fn status(&self, py: Python<'_>) -> String {
        name_of(self.with(py, |brain, _| brain.report().status))
    }

    /// The flight as it is predicted now, if it is.
    #[getter]
    fn flight(&self, py: Python<'_>) -> Option<Flight> {
        self.with(py, |brain, _| brain.report().flight.clone()).map(Flight::of_brain)
    }
}

/// Cameras in a list.
fn camera_list(argument: &str, cameras: &Bound<'_, PyAny>) -> PyResult<Vec<CameraModel>> {
    let cameras = list(argument, cameras, "a list of Camera", |it: &Camera| it.model.clone())?;
    if cameras.is_empty() { Err(fault(argument, "none", "one camera or more")) } else { Ok(cameras) }
}

/// Reads the model of an object.
fn known_object(object: &Bound<'_, PyAny>, known: Option<&Bound<'_, PyAny>>) -> PyResult<KnownObject> {
    let py = object.py();
    let is_file = object.is_instance_of::<pyo3::types::PyString>() || object.hasattr("__fspath__")?;
    let (scan, figures) = if is_file {
        let name: Named = object.extract()?;
        let file = asset(Kind::Object, &name.text(py, "object")?, "object")?;
        let mesh = file.thrown_object().map_err(input_fault)?.mesh;
        (scanned(&mesh)?, file.known_figures().map_err(input_fault)?)
    } else {
        let expected = "a name, a file, (vertices, faces) or (cameras, images)";
        let (one, two): (Bound<'_, PyAny>, Bound<'_, PyAny>) =
            object.extract().map_err(|_| type_fault("object", object, expected))?;
        let is_camera = |it: Bound<'_, PyAny>| it.is_instance_of::<Camera>();
        let is_scan = one.get_item(0).is_ok_and(is_camera);
        let scan = if is_scan { own_scan(&one, &two)? } else { scanned(&surface(&one, &two)?)? };
        (scan, ObjectFigures::default())
    };
    if scan.is_empty() {
        return Err(fault("object", "a scan in which nothing is seen", "one of the object"));
    }
    let Some(known) = known else { return Ok(KnownObject { scan, figures }) };
    let given: toml::Table = InputError::parse_toml("known", &toml_text("known", Some(known))?).map_err(input_fault)?;
    let mut fields = toml::Table::try_from(figures).map_err(|it| PyRuntimeError::new_err(it.to_string()))?;
    fields.extend(given);
    let figures = InputError::parse_toml("known", &fields.to_string()).map_err(input_fault)?;
    Ok(KnownObject { scan, figures })
}

/// The scan of a surface whose middle is at the origin, by the cameras that scan objects in the default
/// scenario.
fn scanned(mesh: &TriangleMesh) -> PyResult<ReferenceScan> {
    let scenario = Scenario::of_asset(&asset(Kind::Scenario, DEFAULT_SCENARIO, "object")?).map_err(input_fault)?;
    let rig = asset(Kind::Rig, &scenario.reference_rig, "object")?;
    Ok(reference_scan(mesh, &rig_from_toml(&rig.file, &rig.text).map_err(input_fault)?))
}

/// A scan that somebody took.
fn own_scan(cameras: &Bound<'_, PyAny>, frames: &Bound<'_, PyAny>) -> PyResult<ReferenceScan> {
    let cameras = camera_list("object", cameras)?;
    let frames = list("object", frames, "images as a list of DepthFrame", DepthFrame::copied)?;
    for frame in &frames {
        let camera = cameras.get(frame.camera);
        if camera.is_none_or(|it| frame.window.intersection(&it.full_window()) != frame.window) || frame.mask.is_none()
        {
            let found = format!("an image of camera {}", frame.camera);
            return Err(fault("object", found, "masked images within those of the scan's cameras"));
        }
    }
    Ok(ReferenceScan { cameras, frames })
}

/// A surface, moved to the origin.
fn surface(vertices: &Bound<'_, PyAny>, faces: &Bound<'_, PyAny>) -> PyResult<TriangleMesh> {
    const SIZES_M: [f64; 2] = [0.005, 1.0];
    let vertices: Vec<Point3<f64>> = Numbers::read("object", vertices, &[0, 3])?.points();
    let corners = Numbers::read("object", faces, &[0, 3])?.values;
    if let Some(corner) = corners.iter().find(|it| it.fract() != 0.0 || !(0.0..vertices.len() as f64).contains(*it)) {
        return Err(fault("object", format!("a face with the corner {corner}"), "indices of vertices"));
    }
    let triangles: Vec<[u32; 3]> =
        corners.chunks_exact(3).map(|it| [it[0], it[1], it[2]].map(|it| it as u32)).collect();
    if triangles.is_empty() {
        return Err(fault("object", "no faces", "a surface"));
    }
    let mesh = TriangleMesh { vertices, triangles };
    let around = mesh.aabb();
    let length_m = around.size.max();
    if !(SIZES_M[0]..=SIZES_M[1]).contains(&length_m) {
        return Err(fault("object", format!("{length_m} m"), format!("{} to {} m", SIZES_M[0], SIZES_M[1])));
    }
    Ok(mesh.translated(&-around.centre.coords))
}

/// Records what a brain saw and wanted in a cell, for `catchingbot view` and `catchingbot replay`.
#[pyclass(frozen, module = "catchingbot")]
pub struct Recorder {
    recorder: Mutex<Option<CellRecorder>>,
}

#[pymethods]
impl Recorder {
    /// Begins the recording `file`, whose name ends with `.catch`. It appears when it is finished.
    #[new]
    fn new(py: Python<'_>, file: Named, brain: &Brain) -> PyResult<Self> {
        let path = PathBuf::from(file.text(py, "file")?);
        let is_recording = path.extension().is_some_and(|it| it == EXTENSION);
        let Some(name) = path.file_stem().and_then(|it| it.to_str()).filter(|_| is_recording) else {
            return Err(fault("file", format!("'{}'", path.display()), format!("a name that ends with .{EXTENSION}")));
        };
        let folder = path.parent().filter(|it| !it.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let recorder = CellRecorder::create(folder, name, brain.recorded());
        let recorder = recorder.map_err(|it| PyOSError::new_err(format!("file: {it}")))?;
        Ok(Self { recorder: Mutex::new(Some(recorder)) })
    }

    /// Adds a tick: what was sensed, and the command that the brain answered.
    fn tick(&self, py: Python<'_>, observation: &Observation, command: &Command) -> PyResult<()> {
        let report = command.snapshot.as_ref().and_then(|it| it.report.as_ref());
        py.detach(|| {
            let mut recorder = locked(&self.recorder);
            let recorder = recorder.as_mut().ok_or_else(finished)?;
            recorder.tick(&observation.sensed, &command.sent, report).map_err(|it| PyOSError::new_err(it.to_string()))
        })
    }

    /// Ends the recording and gives the file its name.
    fn finish(&self, py: Python<'_>) -> PyResult<()> {
        py.detach(|| {
            let recorder = locked(&self.recorder).take();
            let written = recorder.ok_or_else(finished)?.finish();
            written.map(drop).map_err(|it| PyOSError::new_err(it.to_string()))
        })
    }
}

fn finished() -> PyErr {
    PyRuntimeError::new_err("recorder: the recording is finished")
}
