//! The cell's cameras in time: when they look, which pixels they read out, and when their images arrive.

use catch_cell::{CameraModel, DepthFrame, PixelWindow};
use nalgebra::Vector3;

use crate::{
    camera_faults::{CameraFault, CameraFaultKind, Push, SwappedCamera},
    cameras::{DepthCameras, Readout, Renderer, Scene},
    config::ArenaConfig,
    drawn::Drawn,
    person::Person,
    throw_conditions::CameraPose,
};

/// Cameras that look, at every observation or in their own time, and whose images arrive after a while.
#[derive(Debug, Clone)]
pub(crate) struct Sensors {
    pub cameras: DepthCameras,
    clocks: Vec<CameraClock>,
    labels: bool,
    latency_s: Drawn,
    /// The windows that the brain wants; `None` means all that the cameras give by themselves.
    pub windows: Option<Vec<PixelWindow>>,
    /// Faults that have not begun.
    coming_faults: Vec<CameraFault>,
    /// Fault of each camera's images.
    spoilt: Vec<Spoilt>,
    /// Images that have not arrived, with their times of arrival, soonest first.
    under_way: Vec<(f64, DepthFrame)>,
}

/// Fault of a camera's images.
#[derive(Debug, Clone)]
enum Spoilt {
    Not,
    Blinded,
    /// Frozen at an image, by the number of its exposure; `None` until one has come since.
    Frozen(Option<Box<(u64, Scene)>>),
    Silent,
}

/// Exposure times of a camera.
#[derive(Debug, Clone)]
struct CameraClock {
    /// Time of the first image of a free-running camera; `None` for one that takes an image at every
    /// observation.
    phase_s: Option<f64>,
    period_s: f64,
    /// Number of exposures so far.
    exposures: u64,
    /// Arrival time of the newest image, in seconds.
    arrival_s: f64,
}

impl CameraClock {
    /// Returns whether the camera takes an image now.
    fn is_due(&self, now_s: f64, at_observation: bool) -> bool {
        let has_come = |phase_s: f64| now_s + 1e-9 >= phase_s + self.exposures as f64 * self.period_s;
        self.phase_s.map_or(at_observation, has_come)
    }
}

impl Sensors {
    /// The sensors of the scene (`seed`, `index`), whose cameras the brain believes to stand as `calibrated`.
    pub fn new(config: &ArenaConfig, calibrated: &[CameraModel], seed: u64, index: u64) -> Self {
        let mut cameras = DepthCameras::new(calibrated, &config.depth, seed, index);
        cameras.person = config.person.map(|person| Person::new(&person, seed, index));
        let clock = |(i, camera): (usize, &CameraModel)| {
            let period_s = 1.0 / camera.rate_hz.unwrap_or(config.frame_rate_hz);
            let phase_s = config.free_running_cameras.then(|| cameras.phase(i) * period_s);
            CameraClock { phase_s, period_s, exposures: 0, arrival_s: 0.0 }
        };
        Self {
            clocks: calibrated.iter().enumerate().map(clock).collect(),
            cameras,
            labels: config.labels,
            latency_s: config.latency_s,
            windows: None,
            coming_faults: config.camera_faults.iter().filter(|it| it.camera < calibrated.len()).copied().collect(),
            spoilt: vec![Spoilt::Not; calibrated.len()],
            under_way: Vec::new(),
        }
    }

    /// True poses of the cameras, and the phases of those that run freely.
    pub fn camera_poses(&self) -> Vec<CameraPose> {
        let poses = self.cameras.cameras().iter().zip(&self.clocks);
        poses.map(|(camera, clock)| CameraPose { pose: (&camera.X_WC).into(), phase_s: clock.phase_s }).collect()
    }

    /// Returns whether any camera takes an image now.
    pub fn are_due(&self, now_s: f64, at_observation: bool) -> bool {
        self.clocks.iter().any(|clock| clock.is_due(now_s, at_observation))
    }

    /// All cameras that look now look at `scene`.
    pub fn expose(&mut self, renderer: &Renderer, scene: &Scene, at_observation: bool) {
        self.begin_faults(scene.capture_s);
        let clocks = self.clocks.iter().enumerate();
        let due: Vec<(usize, u64)> = clocks
            .filter(|(_, clock)| clock.is_due(scene.capture_s, at_observation))
            .map(|(camera, clock)| (camera, clock.exposures))
            .collect();
        for frame in self.capture(renderer, scene, &due) {
            let clock = &mut self.clocks[frame.camera];
            let latency_s = self.latency_s.at(self.cameras.lateness(frame.camera, clock.exposures));
            clock.arrival_s = clock.arrival_s.max(scene.capture_s + latency_s);
            let at = self.under_way.partition_point(|(at_s, _)| *at_s <= clock.arrival_s);
            self.under_way.insert(at, (clock.arrival_s, frame));
        }
        due.iter().for_each(|(camera, _)| self.clocks[*camera].exposures += 1);
    }

    /// All cameras have looked at `scene` so many times before now; these images arrive at once.
    pub fn expose_before(&mut self, renderer: &Renderer, scene: &Scene, images: usize) {
        for before in (1..=images as u64).rev() {
            for camera in 0..self.clocks.len() {
                let capture_s = scene.capture_s - before as f64 * self.clocks[camera].period_s;
                // No exposure after these has such a number.
                let due = [(camera, u64::MAX - before)];
                let frames = self.capture(renderer, &Scene { capture_s, ..*scene }, &due);
                self.under_way.extend(frames.into_iter().map(|frame| (scene.capture_s, frame)));
            }
        }
    }

    /// The images of cameras that are due, each with the number of its exposure.
    fn capture(&mut self, renderer: &Renderer, scene: &Scene, due: &[(usize, u64)]) -> Vec<DepthFrame> {
        let readout = match &self.windows {
            Some(windows) => Readout::Windows(windows),
            None if self.labels => Readout::Object,
            None => Readout::Full,
        };
        let sees_now = |camera: usize| !matches!(self.spoilt[camera], Spoilt::Silent | Spoilt::Frozen(Some(_)));
        let exposures = due.iter().copied().filter(|(camera, _)| sees_now(*camera));
        let mut frames = self.cameras.capture(renderer, scene, exposures, readout, self.labels);
        for (camera, _) in due {
            let Spoilt::Frozen(Some(still)) = &self.spoilt[*camera] else { continue };
            let (exposure, scene_then) = &**still;
            let again = self.cameras.capture(renderer, scene_then, [(*camera, *exposure)], readout, self.labels);
            frames.extend(again.into_iter().map(|frame| DepthFrame { capture_s: scene.capture_s, ..frame }));
        }
        for frame in &mut frames {
            match &mut self.spoilt[frame.camera] {
                Spoilt::Blinded => {
                    frame.depth_m.fill(f32::NAN);
                    frame.mask.iter_mut().for_each(|mask| mask.fill(false));
                }
                Spoilt::Frozen(still @ None) => {
                    *still = Some(Box::new((self.clocks[frame.camera].exposures, *scene)));
                }
                _ => {}
            }
        }
        frames.sort_by_key(|frame| frame.camera);
        frames
    }

    /// The faults begin whose time has come.
    fn begin_faults(&mut self, now_s: f64) {
        let is_due = |fault: &mut CameraFault| fault.from_s <= now_s;
        for CameraFault { camera, kind, .. } in self.coming_faults.extract_if(.., is_due) {
            match kind {
                CameraFaultKind::Swapped(SwappedCamera { with }) => self.cameras.swap(camera, with),
                CameraFaultKind::Pushed(Push { by_m }) => self.cameras.push(camera, Vector3::from(by_m)),
                CameraFaultKind::Blinded => self.spoilt[camera] = Spoilt::Blinded,
                CameraFaultKind::Frozen => self.spoilt[camera] = Spoilt::Frozen(None),
                CameraFaultKind::Silent => self.spoilt[camera] = Spoilt::Silent,
            }
        }
    }

    /// The images that have arrived by `now_s`, oldest first.
    pub fn arrived(&mut self, now_s: f64) -> Vec<DepthFrame> {
        let count = self.under_way.partition_point(|(at_s, _)| *at_s <= now_s + 1e-9);
        let mut frames: Vec<DepthFrame> = self.under_way.drain(..count).map(|(_, frame)| frame).collect();
        frames.sort_by(|one, two| one.capture_s.total_cmp(&two.capture_s));
        frames
    }
}

#[cfg(test)]
mod tests {
    use catch_body::{Gripper, JointVector, Pose, Robot, TriangleMesh, robot_file::RobotFiles};
    use catch_cell::{CameraModel, rig_from_toml};

    use super::*;
    use crate::{
        depth_noise::{DepthModel, StereoNoise},
        drawn::Between,
    };

    /// Two cameras at 60 and 90 Hz for 20 s, looked at every 10 ms; frames with the times of their
    /// observations.
    fn frames(config: &ArenaConfig, index: u64) -> Vec<(f64, DepthFrame)> {
        frames_of(config, index, 20.0, PixelWindow::default())
    }

    fn frames_of(config: &ArenaConfig, index: u64, duration_s: f64, window: PixelWindow) -> Vec<(f64, DepthFrame)> {
        let files = RobotFiles {
            urdf_file: "robot.urdf",
            urdf: include_str!("../../../assets/robots/iiwa14/robot.urdf"),
            toml_file: "robot.toml",
            toml: include_str!("../../../assets/robots/iiwa14/robot.toml"),
        };
        let gripper = Gripper::from_toml("g", include_str!("../../../assets/grippers/wsg50.toml")).unwrap();
        let robot = Robot::from_files(&files).unwrap().with_mount_of(&gripper);
        let renderer = Renderer::new(&robot, &gripper, &TriangleMesh::sphere(0.03, 2), false);
        let X_WL = robot.link_poses(&JointVector::zeros());
        let mut cameras = rig_from_toml("d435_2", include_str!("../../../assets/rigs/d435_2.toml")).unwrap();
        for (camera, rate_hz) in cameras.iter_mut().zip([60.0, 90.0]) {
            *camera = CameraModel { rate_hz: Some(rate_hz), ..camera.clone() };
        }
        let mut sensors = Sensors::new(config, &cameras, 5, index);
        sensors.windows = Some(vec![window; 2]);
        let mut seen = Vec::new();
        for step in 0..(duration_s * 1e3) as u32 {
            let now_s = f64::from(step) * 1e-3;
            let at_observation = step % 10 == 0;
            if sensors.are_due(now_s, at_observation) {
                let scene = Scene { capture_s: now_s, X_WL, width_m: 0.1, X_WO: Pose::translation(0.0, 0.0, 9.0) };
                sensors.expose(&renderer, &scene, at_observation);
            }
            if at_observation {
                seen.extend(sensors.arrived(now_s).into_iter().map(|frame| (now_s, frame)));
            }
        }
        seen
    }

    #[test]
    fn cameras_run_freely_at_their_own_rates_and_phases() {
        let config = ArenaConfig { free_running_cameras: true, ..ArenaConfig::default() };
        let mut phases = Vec::new();
        for index in 0..40 {
            let seen = frames(&config, index);
            for (camera, rate_hz) in [(0, 60.0), (1, 90.0)] {
                let times: Vec<f64> =
                    seen.iter().filter(|(_, frame)| frame.camera == camera).map(|(_, frame)| frame.capture_s).collect();
                assert!((times.len() as f64 - 20.0 * rate_hz).abs() <= 1.0, "{}", times.len());
                for (n, time_s) in times.iter().enumerate() {
                    // A camera looks in the first step of the physics when it is due.
                    let late_s = time_s - times[0] - n as f64 / rate_hz;
                    assert!(late_s.abs() <= 1.0e-3 + 1e-9, "{late_s}");
                }
                phases.push(times[0] * rate_hz);
            }
            assert!(seen.iter().all(|(now_s, frame)| (0.0..0.01 - 1e-9).contains(&(now_s - frame.capture_s))));
            assert!(seen.windows(2).all(|pair| pair[0].1.capture_s <= pair[1].1.capture_s), "oldest first");
        }
        // Uniform: mean 1/2 and variance 1/12; steps add half of one.
        let mean = phases.iter().sum::<f64>() / phases.len() as f64;
        assert!((mean - 0.5 - 0.04).abs() < 4.0 * (1.0 / 12.0 / phases.len() as f64).sqrt(), "{mean}");
        assert!(phases.iter().any(|it| *it < 0.2) && phases.iter().any(|it| *it > 0.8));
    }

    /// Images of the arm in camera 0 with a fault that begins at 50 ms, before and after, noisy or exact.
    fn spoilt(kind: CameraFaultKind, is_noisy: bool) -> [Vec<Vec<f32>>; 2] {
        let camera_faults = vec![CameraFault { camera: 0, kind, from_s: 0.05 }];
        let mut config = ArenaConfig { camera_faults, ..ArenaConfig::default() };
        if is_noisy {
            config.depth.model = DepthModel::Stereo(StereoNoise::default());
        }
        let window = PixelWindow { left: 0, top: 0, width: 848, height: 480 };
        let seen = frames_of(&config, 0, 0.1, window);
        assert_eq!(seen.iter().filter(|(_, frame)| frame.camera == 1).count(), 10, "the other one goes on");
        assert!(seen.iter().all(|(now_s, frame)| frame.capture_s == *now_s));
        [false, true].map(|after| {
            let of_first = |(now_s, frame): &&(f64, DepthFrame)| frame.camera == 0 && (*now_s >= 0.05) == after;
            seen.iter().filter(of_first).map(|(_, frame)| frame.depth_m.clone()).collect()
        })
    }

    fn are_alike(one: &[f32], other: &[f32]) -> bool {
        one.iter().zip(other).all(|(one, other)| one.to_bits() == other.to_bits() || one.is_nan() && other.is_nan())
    }

    #[test]
    fn cameras_fail_from_their_time_on() {
        let is_seen = |image: &Vec<f32>| image.iter().any(|depth_m| depth_m.is_finite());
        for kind in [CameraFaultKind::Blinded, CameraFaultKind::Frozen, CameraFaultKind::Silent] {
            let [before, after] = spoilt(kind, true);
            assert!(before.len() == 5 && before.iter().all(is_seen) && !are_alike(&before[0], &before[1]));
            match kind {
                CameraFaultKind::Blinded => assert!(after.len() == 5 && !after.iter().any(is_seen)),
                CameraFaultKind::Frozen => {
                    assert!(after.len() == 5 && after.iter().all(|it| are_alike(it, &after[0])));
                    assert!(is_seen(&after[0]) && !are_alike(&before[4], &after[0]));
                }
                _ => assert!(after.is_empty()),
            }
        }
        let swapped = CameraFaultKind::Swapped(SwappedCamera { with: 1 });
        for kind in [swapped, CameraFaultKind::Pushed(Push { by_m: [0.0, 0.02, 0.0] })] {
            let [before, after] = spoilt(kind, false);
            assert!(are_alike(&before[0], &before[4]) && are_alike(&after[0], &after[4]));
            assert!(!are_alike(&before[0], &after[0]));
        }
    }

    #[test]
    fn faults_of_cameras_that_there_are_not_are_named() {
        let rig = rig_from_toml("d435_2", include_str!("../../../assets/rigs/d435_2.toml")).unwrap();
        let fault = |text: &str| {
            let config: ArenaConfig = toml::from_str(&format!("camera_faults = [{text}]")).unwrap();
            config.check_cameras(&rig, "s.toml", "arena").unwrap_err().to_string()
        };
        let found = fault("{ camera = 1, kind = \"blinded\" }, { camera = 2, kind = \"blinded\" }");
        assert!(found.starts_with("s.toml: arena.camera_faults[1].camera: found 2, expected"), "{found}");
        let found = fault("{ camera = 1, kind = { swapped = { with = 9 } } }");
        assert!(found.contains("camera_faults[0].kind.swapped.with: found 9, expected"), "{found}");
    }

    #[test]
    fn images_draw_how_late_they_are_and_keep_their_order() {
        let latency_s = Drawn::Between(Between { min: 0.02, max: 0.05 });
        let config = ArenaConfig { free_running_cameras: true, latency_s, ..ArenaConfig::default() };
        let seen = frames(&config, 0);
        let late_s: Vec<f64> = seen.iter().map(|(now_s, frame)| now_s - frame.capture_s).collect();
        // Observations come every 10 ms.
        assert!(late_s.iter().all(|it| (0.02 - 1e-9..0.06 + 1e-9).contains(it)));
        let mean = late_s.iter().sum::<f64>() / late_s.len() as f64;
        // 35 ms, half an interval, and what waiting for the image before adds.
        assert!((0.038..0.046).contains(&mean), "{mean}");
        for camera in 0..2 {
            let times = seen.iter().filter(|(_, frame)| frame.camera == camera).map(|(_, frame)| frame.capture_s);
            assert!(times.is_sorted(), "a camera's images arrive in their order");
        }
        let overtaken = seen.windows(2).filter(|pair| pair[0].1.capture_s > pair[1].1.capture_s).count();
        assert!(overtaken > 10, "images of different cameras overtake each other: {overtaken}");
    }

    #[test]
    fn without_either_all_cameras_look_at_observations() {
        let seen = frames(&ArenaConfig::default(), 0);
        assert_eq!(seen.len(), 2 * 2000);
        assert!(seen.iter().all(|(now_s, frame)| frame.capture_s == *now_s));
    }
}
