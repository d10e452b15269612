//! Derivatives of what is predicted, against central differences of renderings.

use std::collections::{BTreeMap, BTreeSet};

use catch_body::{Gripper, Robot, pose::look_at, ray_cast::SurfacePart, robot_file::RobotFiles};
use catch_cell::CameraModel;
use nalgebra::{Point3, Vector3};

use super::{
    ArmSample, Config,
    coarse::moved,
    depths,
    measurement::Measurement,
    normal_equations::Row,
    parameters::{CameraState, FIRST_NUISANCE, OF_CAMERA, Patch, PosedArm, Shared, TIME_OFFSET, TIME_OFFSET_SD_S},
    rendering::Rendering,
    silhouettes,
};

fn arm() -> (Robot, Gripper) {
    let files = RobotFiles {
        urdf_file: "robot.urdf",
        urdf: include_str!("../../../assets/robots/iiwa14/robot.urdf"),
        toml_file: "robot.toml",
        toml: include_str!("../../../assets/robots/iiwa14/robot.toml"),
    };
    let gripper = Gripper::from_toml("wsg50.toml", include_str!("../../../assets/grippers/wsg50.toml")).unwrap();
    (Robot::from_files(&files).unwrap().with_mount_of(&gripper), gripper)
}

/// Everything that predictions depend on.
#[derive(Clone)]
struct World {
    config: Config,
    robot: Robot,
    gripper: Gripper,
    camera: CameraModel,
    shared: Shared,
    sample: ArmSample,
}

impl World {
    fn new() -> Self {
        let (robot, gripper) = arm();
        let X_WC = look_at(&Point3::new(1.8, -0.7, 1.3), &Point3::new(0.3, 0.1, 0.6));
        let q = robot.joint_vector(&[0.3, 0.7, -0.4, -1.3, 0.5, 0.9, 0.2]).unwrap();
        let dq = robot.joint_vector(&[0.5, -0.3, 0.4, 0.6, -0.5, 0.3, 1.0]).unwrap();
        Self {
            camera: CameraModel::with_field_of_view(X_WC, 848, 480, 1.0),
            shared: Shared::new(&robot),
            sample: ArmSample { time_s: 0.0, q, dq, width_m: 0.08 },
            config: Config::default(),
            robot,
            gripper,
        }
    }

    fn posed(&self) -> PosedArm<'_> {
        PosedArm::new(&self.robot, &self.sample, &self.shared)
    }

    fn measured(&self) -> Vec<Measurement> {
        let surface = self.shared.surface(&self.robot, &self.gripper);
        let posed = self.posed();
        let rendering = Rendering::new(&self.camera, &surface, &posed.X_WL, posed.width_m);
        let mut found = Vec::new();
        depths::measure(&mut found, &rendering, &self.camera, None, &self.config);
        silhouettes::measure(&mut found, &rendering, &self.camera, None, &self.config);
        // Places in silhouettes count in the rendering's window.
        let (left, top) = (rendering.window.left as i32, rendering.window.top as i32);
        for it in found.iter_mut().filter(|it| !it.is_depth()) {
            let along_row = is_along_row(it);
            it.place[0] += if along_row { top } else { left };
            it.place[1] += if along_row { left } else { top };
        }
        found
    }

    /// The world moved along one parameter, counted as the rows count it.
    fn changed(&self, parameter: usize, by: f64) -> Self {
        let mut world = self.clone();
        match parameter {
            0..=2 => world.camera.X_WC *= moved(&Vector3::zeros(), &(Vector3::ith(parameter, by))),
            3..=5 => world.camera.X_WC *= moved(&Vector3::ith(parameter - 3, by), &Vector3::zeros()),
            TIME_OFFSET => world.sample.q += self.sample.dq * (by * TIME_OFFSET_SD_S),
            _ => world.shared.values[parameter - OF_CAMERA] += by,
        }
        world
    }
}

fn is_along_row(it: &Measurement) -> bool {
    matches!(it.quantity, super::measurement::Quantity::ShownPixels { along_row: true, .. })
}

type Key = (bool, bool, [i32; 2]);

fn key(it: &Measurement) -> Key {
    (it.is_depth(), is_along_row(it), it.place)
}

fn entry(row: &Row, parameter: usize) -> f64 {
    row.iter().find(|(at, _)| *at == parameter).map_or(0.0, |(_, entry)| *entry)
}

/// Derivatives of depths and of silhouettes agree with finite differences: for each parameter half of them
/// within 2 %, and 90 % within 10 %; the others are beside the edges of the surfaces' flat facets.
#[test]
fn derivatives_are_those_of_the_renderings() {
    let world = World::new();
    let state = CameraState { X_WC: world.camera.X_WC, nuisance: [0.0; OF_CAMERA - FIRST_NUISANCE] };
    let size = OF_CAMERA + world.shared.values.len() + 1;
    let measured = world.measured();
    let posed = world.posed();
    let dof = world.robot.dof();
    for parameter in (0..6).chain([TIME_OFFSET]).chain(OF_CAMERA..size - 1) {
        let predicted = |by: f64| -> BTreeMap<Key, f64> {
            world.changed(parameter, by).measured().iter().map(|it| (key(it), it.predicted)).collect()
        };
        for depths in [true, false] {
            // Silhouettes are found to a 256th of a pixel, which their motion has to be well above.
            let of_links = OF_CAMERA + dof..OF_CAMERA + 2 * dof + 1;
            let step = match parameter {
                0..6 => 2e-4,
                _ if parameter == TIME_OFFSET || of_links.contains(&parameter) => 0.05,
                // In standard deviations that are small.
                _ if parameter < of_links.start => 1.0,
                _ => 0.2,
            };
            let step = if depths { step } else { 5.0 * step };
            let (after, before) = (predicted(step), predicted(-step));
            let (mut errors, mut sizes) = (Vec::new(), Vec::new());
            let mut row = Row::new();
            for it in measured.iter().filter(|it| it.is_depth() == depths) {
                let (Some(after), Some(before)) = (after.get(&key(it)), before.get(&key(it))) else { continue };
                posed.row(&mut row, it, &state, 0.0);
                errors.push(((after - before) / (2.0 * step) - entry(&row, parameter)).abs());
                sizes.push(entry(&row, parameter).abs());
            }
            assert!(errors.len() > 100, "{parameter}: {}", errors.len());
            let scale = sizes.iter().copied().fold(0.0, f64::max);
            errors.sort_by(f64::total_cmp);
            let [half, most] = [errors.len() / 2, errors.len() * 9 / 10].map(|at| errors[at] / scale.max(1e-12));
            assert!(half < 0.02 && most < 0.1, "parameter {parameter}, depths {depths}: {half}, {most}");
        }
    }
}

/// A patch that rises changes what is measured of it as the whole link does, and its correction is what its
/// derivative says.
#[test]
fn patches_count_as_their_links_do() {
    let mut world = World::new();
    let state = CameraState { X_WC: world.camera.X_WC, nuisance: [0.0; OF_CAMERA - FIRST_NUISANCE] };
    let measured = world.measured();
    let patches: BTreeSet<Patch> = measured.iter().filter_map(|it| world.posed().patch(it, &state.X_WC)).collect();
    let others = world.shared.values.len();
    world.shared.add_patches(&patches);
    world.shared.values[others..].fill(1.0);
    assert!(patches.len() > 50 && world.shared.values.len() == others + patches.len());
    let posed = world.posed();
    let (mut row, mut checked) = (Row::new(), 0);
    for it in &measured {
        posed.row(&mut row, it, &state, 0.0);
        let of_patches: Vec<f64> =
            row.iter().filter(|(at, _)| *at >= OF_CAMERA + others).map(|(_, entry)| *entry).collect();
        let correction = posed.patch_correction(it, posed.patch(it, &state.X_WC));
        assert!((of_patches.iter().sum::<f64>() - correction).abs() < 1e-15 && of_patches.len() <= 1);
        let SurfacePart::Link(_) = it.part else { continue };
        assert!(of_patches.iter().all(|of_patch| row.iter().filter(|(_, entry)| entry == of_patch).count() >= 2));
        checked += of_patches.len();
    }
    assert!(checked > 1000, "{checked}");
}
