//! Sections of the pages of files: the struct or enum at each place of each file.

/// A table of a file.
pub struct Section {
    /// Heading on the page.
    pub heading: &'static str,
    /// Path within the scenario, which has defaults; empty elsewhere, and for the scenario's own fields.
    pub path: &'static str,
    /// A setting with which its defaults are there.
    pub with: &'static str,
    /// File below `crates`, and the item in it.
    pub source: (&'static str, &'static str),
}

const fn at(path: &'static str, file: &'static str, item: &'static str) -> Section {
    Section { heading: path, path, with: "", source: (file, item) }
}

const fn of(heading: &'static str, file: &'static str, item: &'static str) -> Section {
    Section { heading, path: "", with: "", source: (file, item) }
}

const fn with(
    path: &'static str,
    heading: &'static str,
    with: &'static str,
    source: (&'static str, &'static str),
) -> Section {
    Section { heading, path, with, source }
}

const ARENA: &str = "catch_sim/src/config.rs";
const FAULTS: &str = "catch_sim/src/camera_faults.rs";
const DEPTH: &str = "catch_sim/src/depth_noise.rs";

/// A scenario.
pub const SCENARIO: &[Section] = &[
    of("The file", "catch_lab/src/scenario.rs", "Scenario"),
    at("limit_scale", "catch_body/src/robot.rs", "LimitScale"),
    at("clock", "catch_lab/src/scenario.rs", "Clock"),
    with("calibration", "calibration", "calibration={}", ("catch_lab/src/scenario.rs", "CalibrationSettings")),
    at("arena", ARENA, "ArenaConfig"),
    of("Numbers that are drawn", "catch_sim/src/drawn.rs", "Between"),
    of("arena.camera_faults", FAULTS, "CameraFault"),
    of("arena.camera_faults, kind", FAULTS, "CameraFaultKind"),
    of("arena.camera_faults, kind swapped", FAULTS, "SwappedCamera"),
    of("arena.camera_faults, kind pushed", FAULTS, "Push"),
    with(
        "arena.person",
        "arena.person",
        "arena.person={ nearest_m = 2, speed_mps = 1 }",
        ("catch_sim/src/person.rs", "PersonConfig"),
    ),
    at("arena.aerodynamics", "catch_sim/src/aerodynamics.rs", "AerodynamicsConfig"),
    at("arena.robot_errors", ARENA, "RobotErrors"),
    at("arena.robot_controller", ARENA, "RobotController"),
    at("arena.robot_controller.gains", ARENA, "ControllerGains"),
    of("arena.robot_controller.links", ARENA, "ModelLink"),
    at("arena.depth", DEPTH, "DepthConfig"),
    at("arena.depth.model", DEPTH, "DepthModel"),
    of("arena.depth.model.gaussian", DEPTH, "GaussianNoise"),
    with(
        "arena.depth.model.stereo",
        "arena.depth.model.stereo",
        "arena.depth.model={ stereo = {} }",
        (DEPTH, "StereoNoise"),
    ),
    at("brain", "catch_recording/src/brain.rs", "BrainSettings"),
    at("brain.perception", "catch_bot/src/perception/mod.rs", "Config"),
    of("brain.perception.depth_noise", "catch_bot/src/perception/point_cloud.rs", "DepthNoise"),
    at("brain.trajectory_prediction", "catch_bot/src/trajectory_prediction/mod.rs", "Config"),
    at(
        "brain.trajectory_prediction.aerodynamics",
        "catch_bot/src/trajectory_prediction/aerodynamics.rs",
        "AerodynamicPrior",
    ),
    at(
        "brain.trajectory_prediction.process_noise",
        "catch_bot/src/trajectory_prediction/process_noise.rs",
        "ProcessNoise",
    ),
    at("brain.grasp_selection", "catch_bot/src/grasp_selection/mod.rs", "Config"),
    at("brain.grasp_selection.weights", "catch_bot/src/grasp_selection/heuristics.rs", "Weights"),
    at("brain.trajectory_optimization", "catch_bot/src/trajectory_optimization/mod.rs", "Config"),
    at("brain.trajectory_optimization.weights", "catch_bot/src/trajectory_optimization/search/settings.rs", "Weights"),
    at("brain.control", "catch_bot/src/control/mod.rs", "Config"),
    at("brain.paper_method", "catch_paper/src/lib.rs", "Config"),
    at("brain.paper_method.registration", "catch_paper/src/registration.rs", "Config"),
    at("brain.paper_method.prediction", "catch_paper/src/prediction.rs", "SamplingConfig"),
    at("brain.paper_method.grasp", "catch_paper/src/grasp.rs", "Config"),
    at("brain.paper_method.motion", "catch_paper/src/motion.rs", "Config"),
];

/// The other files.
pub const FILES: &[Section] = &[
    of("Robot", "catch_body/src/robot_file.rs", "RobotFile"),
    of("Robot: base", "catch_body/src/pose.rs", "PoseFields"),
    of("Robot: flange", "catch_body/src/robot_file.rs", "FlangeFields"),
    of("Robot: contact_stop", "catch_body/src/robot.rs", "ContactStop"),
    of("Robot: poses", "catch_body/src/robot_file.rs", "PosesFields"),
    of("Robot: joints.NAME", "catch_body/src/robot_file.rs", "JointFields"),
    of("Robot: joints.NAME.velocity_by_position", "catch_body/src/velocity_table.rs", "VelocityFields"),
    of("Robot: links.NAME", "catch_body/src/robot_file/inertia.rs", "LinkFields"),
    of("Robot: collision", "catch_body/src/robot_file.rs", "CollisionFields"),
    of("Robot: collision.capsules", "catch_body/src/robot_file/capsules.rs", "CapsuleFields"),
    of("Robot: visuals.NAME", "catch_body/src/visual.rs", "Visual"),
    of("Gripper", "catch_body/src/gripper.rs", "Gripper"),
    of("Gripper: drive", "catch_body/src/gripper.rs", "Drive"),
    of("Gripper: control of the drive", "catch_body/src/gripper.rs", "DriveControl"),
    of("Gripper: published", "catch_body/src/gripper.rs", "PublishedParts"),
    of("Gripper: visuals", "catch_body/src/gripper.rs", "GripperVisuals"),
    of("Object", "catch_sim/src/object.rs", "ObjectFile"),
    of("Object: truth", "catch_sim/src/object.rs", "TruthFields"),
    of("Object: truth.shape", "catch_sim/src/object_shape.rs", "ShapeFields"),
    of("Object: known", "catch_cell/src/knowledge.rs", "ObjectFigures"),
    of("Object: published", "catch_sim/src/object/published.rs", "PublishedFields"),
    of("Throw", "catch_sim/src/throw.rs", "ThrowFile"),
    of("Throw: motion", "catch_sim/src/throw.rs", "Motion"),
    of("Throw: motion, kind random", "catch_sim/src/throw/random.rs", "RandomMotion"),
    of("Throw: motion, kind recorded", "catch_sim/src/throw/recorded.rs", "RecordedMotion"),
    of("Camera", "catch_cell/src/knowledge.rs", "DataSheet"),
    of("Rig", "catch_cell/src/rig.rs", "RigFile"),
    of("Rig: uv_sphere", "catch_cell/src/rig.rs", "UvSphereFields"),
    of("Rig: cameras", "catch_cell/src/rig.rs", "CameraFields"),
    of("Rig: cameras.calibration", "catch_cell/src/rig_calibration.rs", "RigCalibration"),
    of("Workcell", "catch_body/src/workcell.rs", "WorkcellFields"),
    of("Workcell: boxes", "catch_body/src/workcell.rs", "BoxFields"),
    of("Workcell: capsules", "catch_body/src/workcell.rs", "CapsuleFields"),
    of("Learned flights", "catch_lab/src/flights/flight_prior.rs", "FlightPrior"),
    of("Real cell (CELL.toml)", "catch_cell/src/cell_file.rs", "CellFile"),
    of("Real cell: `arm`", "catch_cell/src/cell_file.rs", "ArmLink"),
    of("Real cell: `hand`", "catch_cell/src/cell_file.rs", "HandLink"),
    of("Real cell: `cameras`", "catch_cell/src/cell_file.rs", "CameraLink"),
    of("Real cell: `safe_box`", "catch_cell/src/cell_file.rs", "SafeBox"),
];

/// Strict structs that are no file of a user, or, as cases to plan, stand in the help of their command.
pub const ELSEWHERE: &[(&str, &str)] = &[
    ("catch_bot/src/preparation.rs", "Config"),
    ("catch_cell/src/knowledge.rs", "ObjectFile"),
    ("catch_lab/src/evaluation/published.rs", "PublishedRate"),
    ("catch_lab/src/planner_cases.rs", "Document"),
    ("catch_lab/src/planner_cases.rs", "Case"),
];

/// Words in tables: statuses of the brain, reasons of the referee, and messages of a robot controller.
pub const STATUSES: &[Section] = &[
    of("Why a throw was not caught", "catch_lab/src/referee/reason.rs", "Reason"),
    of("Status of a tick", "catch_bot/src/control/decision.rs", "Status"),
    of("What a registration of a cloud found", "catch_import/src/cloud_registration.rs", "RegistrationStatus"),
    of("Why no pose was found", "catch_bot/src/perception/mod.rs", "PerceptionStatus"),
    of("Why no flight was found", "catch_bot/src/trajectory_prediction/mod.rs", "PredictionStatus"),
    of("Why no catch was planned", "catch_bot/src/trajectory_optimization/mod.rs", "PlanningFailure"),
    of("Why a trajectory was rejected", "catch_cell/src/rejection.rs", "Rejection"),
    of("Which limit was broken", "catch_cell/src/rejection.rs", "LimitKind"),
    of("State of the gripper", "catch_cell/src/gripper.rs", "GraspState"),
    of("Phase of a life of many throws", "catch_bot/src/cycle.rs", "Phase"),
];

/// A recording, from the outside to the inside.
pub const RECORDINGS: &[Section] = &[
    of("Header", "catch_recording/src/recording.rs", "Header"),
    of("Simulation", "catch_lab/src/recording.rs", "Simulation"),
    of("Cell", "catch_recording/src/recording.rs", "RecordedCell"),
    of("Camera", "catch_cell/src/camera.rs", "CameraModel"),
    of("Tick", "catch_recording/src/recording.rs", "RecordedTick"),
    of("Observation", "catch_cell/src/lib.rs", "Observation"),
    of("State of the arm", "catch_cell/src/arm.rs", "ArmState"),
    of("State of the gripper", "catch_cell/src/gripper.rs", "GripperState"),
    of("Depth image", "catch_cell/src/camera.rs", "DepthFrame"),
    of("Command", "catch_cell/src/lib.rs", "Command"),
    of("Trajectory", "catch_cell/src/arm.rs", "ArmTrajectory"),
    of("Gripper move", "catch_cell/src/gripper.rs", "GripperMove"),
    of("Report of the brain", "catch_recording/src/recording.rs", "RecordedReport"),
    of("Plan", "catch_recording/src/recording.rs", "RecordedPlan"),
    of("Ending", "catch_recording/src/recording.rs", "Ending"),
    of("Ground truth", "catch_lab/src/recording.rs", "GroundTruth"),
    of("Truth", "catch_sim/src/truth.rs", "Truth"),
    of("Conditions", "catch_sim/src/throw_conditions.rs", "ThrowConditions"),
    of("Conditions of object and flight", "catch_sim/src/throw_conditions.rs", "FlightConditions"),
    of("Release", "catch_sim/src/throw_conditions.rs", "ReleaseState"),
    of("Conditions of arm, gripper and cameras", "catch_sim/src/throw_conditions.rs", "CellConditions"),
    of("Pose of a frame", "catch_sim/src/throw_conditions.rs", "FramePose"),
    of("Pose of a camera", "catch_sim/src/throw_conditions.rs", "CameraPose"),
];

/// Columns of an evaluation's rows.
pub const ROWS: &[(&str, &str)] = &[
    ("catch_lab/src/scenario/setup.rs", "Scene"),
    ("catch_lab/src/referee.rs", "Verdict"),
    ("catch_lab/src/referee/measures.rs", "Measures"),
    ("catch_sim/src/throw_conditions.rs", "FlightConditions"),
];
/// The release, of which each component stands in a column of its own.
pub const RELEASE: (&str, &str) = ("catch_sim/src/throw_conditions.rs", "ReleaseState");
/// Result of the oracle, which stands in columns of its own.
pub const REACH: (&str, &str) = ("catch_lab/src/reachability/oracle.rs", "Reach");
