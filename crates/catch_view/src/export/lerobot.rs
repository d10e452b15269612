//! Throws as a LeRobotDataset of version 3.0: an episode per throw, a frame per image, depth images included.
//!
//! Layout and keys are those of the `lerobot` package (`lerobot/datasets`): `meta/info.json`,
//! `meta/stats.json`, `meta/tasks.parquet`, `meta/episodes/`, and a Parquet file for each episode in `data/`.
//! Depth images are 16-bit PNG in millimetres within these files, 0 where nothing was measured;
//! `info.is_depth_map` marks them.

mod columns;
mod statistics;

use std::{
    fs::{self, File},
    io::Write,
    path::{Path, PathBuf},
};

use catch_body::InputError;
use catch_cell::{Brain, Observation, executor::GripperQueue};
use serde_json::{Map, Value, json};

use self::{
    columns::{Column, Values},
    statistics::Statistics,
};
use catch_lab::{
    VERSION, png, referee,
    scenario::setup::Setup,
    trial::{Episode, StateSnapshot, stopwatch::Stopwatch},
};
use catch_recording::whole_file::{COMMAND_LINE, replace};

/// Version of the format.
const FORMAT: &str = "v3.0";
/// Files in a folder at most.
const CHUNK: usize = 1000;

/// A dataset that grows throw by throw.
#[derive(Debug)]
pub struct LeRobotDataset {
    folder: PathBuf,
    setup: Setup,
    /// Frames of each episode.
    lengths: Vec<usize>,
    statistics: Statistics,
}

/// Chunk and file of an episode's data.
fn place(episode: usize) -> (usize, usize) {
    (episode / CHUNK, episode % CHUNK)
}

impl LeRobotDataset {
    /// An empty one in a folder that is not there or has nothing in it.
    ///
    /// # Errors
    /// A folder with something in it, or one that cannot be made.
    pub fn create(folder: &Path, setup: &Setup) -> Result<Self, InputError> {
        let made = fs::create_dir_all(folder).and_then(|()| Ok(fs::read_dir(folder)?.next().is_none()));
        let expected = "an empty folder, or one that can be made";
        let is_empty = made.map_err(|fault| InputError::unwritten(folder.display(), &fault, expected))?;
        if !is_empty {
            let found = format!("`{}`, which holds files", folder.display());
            return Err(InputError::new(COMMAND_LINE, "--lerobot", found, expected));
        }
        let (folder, setup) = (folder.to_owned(), setup.clone());
        Ok(Self { folder, setup, lengths: Vec::new(), statistics: Statistics::default() })
    }

    /// Throws number `index` of `seed` as the next episode; whether it was caught.
    ///
    /// # Errors
    /// If the episode cannot be written.
    pub fn throw(&mut self, seed: u64, index: u64) -> Result<bool, InputError> {
        let (mut frames, caught) = Frames::of(&self.setup, seed, index);
        let (episode, length) = (self.lengths.len(), frames.count);
        let first: usize = self.lengths.iter().sum();
        let fps = self.fps();
        let numbers = |from: usize| Values::Whole((0..length).map(|frame| (from + frame) as i64).collect());
        let same = |value: usize| Values::Whole(vec![value as i64; length]);
        let last = |value: bool| (0..length).map(|frame| value && frame + 1 == length).collect::<Vec<bool>>();
        let rewards = last(caught).into_iter().map(|it| f32::from(u8::from(it))).collect();
        frames.columns.extend([
            Column::new("next.reward", Values::Numbers(rewards)),
            Column::new("next.done", Values::Flags(last(true))),
            Column::new("timestamp", Values::Numbers((0..length).map(|it| (it as f64 / fps) as f32).collect())),
            Column::new("frame_index", numbers(0)),
            Column::new("episode_index", same(episode)),
            Column::new("index", numbers(first)),
            Column::new("task_index", same(0)),
        ]);
        self.statistics.add(&frames.columns, &frames.depth_mm);
        let (chunk, file) = place(episode);
        self.write(&format!("data/chunk-{chunk:03}/file-{file:03}.parquet"), &frames.columns, None)?;
        self.lengths.push(length);
        Ok(caught)
    }

    /// Writes what describes the whole.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn finish(self) -> Result<(), InputError> {
        let count = self.lengths.len();
        let ends: Vec<i64> = self
            .lengths
            .iter()
            .scan(0, |end, it| {
                Some({
                    *end += *it as i64;
                    *end
                })
            })
            .collect();
        let begins = ends.iter().zip(&self.lengths).map(|(end, length)| end - *length as i64).collect();
        let whole = |of: &dyn Fn(usize) -> usize| Values::Whole((0..count).map(|it| of(it) as i64).collect());
        let episodes = [
            Column::new("episode_index", whole(&|it| it)),
            Column::new("tasks", Values::Texts(vec![vec![self.task()]; count])),
            Column::new("length", whole(&|it| self.lengths[it])),
            Column::new("data/chunk_index", whole(&|it| place(it).0)),
            Column::new("data/file_index", whole(&|it| place(it).1)),
            Column::new("dataset_from_index", Values::Whole(begins)),
            Column::new("dataset_to_index", Values::Whole(ends)),
            Column::new("meta/episodes/chunk_index", whole(&|_| 0)),
            Column::new("meta/episodes/file_index", whole(&|_| 0)),
        ];
        self.write("meta/episodes/chunk-000/file-000.parquet", &episodes, None)?;
        let tasks =
            [Column::new("task_index", Values::Whole(vec![0])), Column::new("task", Values::Words(vec![self.task()]))];
        self.write("meta/tasks.parquet", &tasks, Some(pandas_index("task", "task_index")))?;
        self.write_json("meta/stats.json", &self.statistics.document())?;
        self.write_json("meta/info.json", &self.info())
    }

    /// Task of the arm, in words.
    fn task(&self) -> String {
        format!("catch the {}", self.setup.scenario.object.replace('_', " "))
    }

    fn fps(&self) -> f64 {
        let arena = &self.setup.scenario.arena;
        1.0 / (arena.steps_per_frame() as f64 * arena.step_s)
    }

    fn info(&self) -> Value {
        let dof = self.setup.robot.dof();
        let joints = |what: &str| (0..dof).map(|i| format!("{what}_{i}")).collect::<Vec<String>>();
        let width = || vec!["gripper_width_m".to_owned()];
        let mut features = Map::new();
        let mut add = |name: &str, dtype: &str, shape: &[usize], names: Value| {
            features.insert(name.to_owned(), json!({ "dtype": dtype, "shape": shape, "names": names }));
        };
        add(
            "observation.state",
            "float32",
            &[2 * dof + 1],
            json!([joints("q_rad"), joints("dq_radps"), width()].concat()),
        );
        add("action", "float32", &[dof + 1], json!([joints("q_rad"), width()].concat()));
        for name in ["next.reward", "timestamp"] {
            add(name, "float32", &[1], Value::Null);
        }
        add("next.done", "bool", &[1], Value::Null);
        for name in ["frame_index", "episode_index", "index", "task_index"] {
            add(name, "int64", &[1], Value::Null);
        }
        for (camera, model) in self.setup.cameras.iter().enumerate() {
            let feature = json!({
                "dtype": "image",
                "shape": [model.height_px, model.width_px, 1],
                "names": ["height", "width", "channels"],
                "info": { "is_depth_map": true, "depth_unit": "mm" },
            });
            features.insert(depth_key(camera), feature);
        }
        let frames: usize = self.lengths.iter().sum();
        json!({
            "codebase_version": FORMAT,
            "robot_type": self.setup.scenario.robot,
            "total_episodes": self.lengths.len(),
            "total_frames": frames,
            "total_tasks": 1,
            "chunks_size": CHUNK,
            "data_files_size_in_mb": 100,
            "video_files_size_in_mb": 200,
            "fps": self.fps().round() as u64,
            "splits": { "train": format!("0:{}", self.lengths.len()) },
            "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
            "video_path": null,
            "features": features,
        })
    }

    fn write(&self, name: &str, columns: &[Column], about: Option<(String, String)>) -> Result<(), InputError> {
        self.file(name, |file| columns::write(file, columns, about).map_err(std::io::Error::other))
    }

    fn write_json(&self, name: &str, document: &Value) -> Result<(), InputError> {
        self.file(name, |file| writeln!(file, "{document:#}"))
    }

    fn file(&self, name: &str, write: impl FnOnce(&mut File) -> std::io::Result<()>) -> Result<(), InputError> {
        let path = self.folder.join(name);
        let made = path.parent().map_or(Ok(()), fs::create_dir_all);
        made.map_err(|fault| InputError::unwritten(path.display(), &fault, "a folder that can be written"))?;
        replace(&path, "a place to write to", write)
    }
}

/// The key of a camera's depth images.
fn depth_key(camera: usize) -> String {
    format!("observation.images.depth_{camera}")
}

/// Metadata with which pandas reads a column as the index of a table with another one.
fn pandas_index(index: &str, other: &str) -> (String, String) {
    let column = |name: &str, kind: &str, numpy: &str| json!({ "name": name, "field_name": name, "pandas_type": kind, "numpy_type": numpy, "metadata": null });
    let about = json!({
        "index_columns": [index],
        "column_indexes": [{ "name": null, "field_name": null, "pandas_type": "unicode", "numpy_type": "object", "metadata": { "encoding": "UTF-8" } }],
        "columns": [column(other, "int64", "int64"), column(index, "unicode", "object")],
        "creator": { "library": "catchingbot", "version": VERSION },
        "pandas_version": "2.0.0",
    });
    ("pandas".to_owned(), about.to_string())
}

/// The frames of a throw, column by column.
struct Frames {
    count: usize,
    columns: Vec<Column>,
    /// Name, sums over all measured depths: what statistics need of images.
    depth_mm: Vec<(String, statistics::Moments)>,
}

impl Frames {
    /// Throws with the scenario's brain. A frame has what was sensed and, as its action, what the robot
    /// controller asks for one image later.
    fn of(setup: &Setup, seed: u64, index: u64) -> (Self, bool) {
        let (mut episode, mut brain) = (Episode::new(setup, seed, index), setup.brain(seed, index));
        let dof = setup.robot.dof();
        let (mut states, mut actions, mut count) = (Vec::new(), Vec::new(), 0);
        let mut images: Vec<Vec<Vec<u8>>> = vec![Vec::new(); setup.cameras.len()];
        let mut moments = vec![statistics::Moments::default(); setup.cameras.len()];
        let (mut moves, mut width_m) = (GripperQueue::default(), setup.gripper.max_width_m);
        let mut action = |sensed: &Observation, moves: &mut GripperQueue| {
            while let Some(due) = moves.take_due(sensed.time_s, |start_s| start_s) {
                width_m = due.width_m;
            }
            actions.extend(sensed.arm.commanded.q.as_slice()[..dof].iter().chain([&width_m]).map(|it| *it as f32));
        };
        let mut stopwatch = Stopwatch::default();
        while !episode.is_done() {
            let sensed = episode.sense();
            if count > 0 {
                action(&sensed, &mut moves);
            }
            count += 1;
            let arm = [&sensed.arm.q, &sensed.arm.dq].map(|it| &it.as_slice()[..dof]).concat();
            states.extend(arm.iter().chain([&sensed.gripper.width_m]).map(|it| *it as f32));
            for (camera, images) in images.iter_mut().enumerate() {
                let depth_mm = depth_image(setup, &sensed, camera);
                depth_mm.iter().for_each(|it| moments[camera].add(f64::from(*it)));
                let model = &setup.cameras[camera];
                images.push(png::gray16(model.width_px, model.height_px, &depth_mm));
            }
            stopwatch.start();
            let command = brain.tick(&sensed, &mut stopwatch);
            stopwatch.stop();
            if let Some(sent) = &command.gripper {
                moves.receive(sent, sensed.time_s);
            }
            let report = Some(brain.report().clone());
            let snapshot = StateSnapshot { time_s: sensed.time_s, report, stage_ms: Vec::new() };
            episode.act(&command, snapshot, stopwatch.last_tick_s());
            if episode.is_done() {
                // Nothing follows the last image.
                action(&sensed, &mut moves);
            }
        }
        let caught = referee::judge(setup, &episode.into_trial(stopwatch)).caught;
        let mut columns = vec![
            Column::new("observation.state", Values::Vectors(2 * dof + 1, states)),
            Column::new("action", Values::Vectors(dof + 1, actions)),
        ];
        columns.extend(images.into_iter().enumerate().map(|(i, it)| Column::new(&depth_key(i), Values::Images(it))));
        let depth_mm = moments.into_iter().enumerate().map(|(i, it)| (depth_key(i), it)).collect();
        (Self { count, columns, depth_mm }, caught)
    }
}

/// The image of a camera in millimetres, 0 where nothing was measured or where it was not read out.
fn depth_image(setup: &Setup, sensed: &Observation, camera: usize) -> Vec<u16> {
    let model = &setup.cameras[camera];
    let width = model.width_px as usize;
    let mut image = vec![0_u16; width * model.height_px as usize];
    for frame in sensed.frames.iter().filter(|frame| frame.camera == camera) {
        let window = &frame.window;
        for (i, depth_m) in frame.depth_m.iter().enumerate().filter(|(_, depth_m)| depth_m.is_finite()) {
            let (row, column) = (i / window.width as usize, i % window.width as usize);
            let at = (window.top as usize + row) * width + window.left as usize + column;
            // Beyond 65 m it is the farthest.
            image[at] = (depth_m * 1e3).round() as u16;
        }
    }
    image
}

#[cfg(test)]
mod tests {
    use super::*;
    use catch_lab::scenario::setup::Choice;
    use parquet::{
        file::reader::{FileReader, SerializedFileReader},
        record::Field,
    };

    #[test]
    fn a_dataset_has_its_throws() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("dataset");
        let setup =
            Setup::load(&Choice { scenario: Some("paper"), throw: Some("near_sampled"), ..Choice::default() }).unwrap();
        let mut dataset = LeRobotDataset::create(&path, &setup).unwrap();
        assert!(dataset.throw(1, 0).unwrap());
        let length = dataset.lengths[0];
        dataset.finish().unwrap();
        let read = |name: &str| serde_json::from_str::<Value>(&fs::read_to_string(path.join(name)).unwrap()).unwrap();
        let (info, stats) = (read("meta/info.json"), read("meta/stats.json"));
        assert_eq!((&info["total_frames"], &info["fps"]), (&json!(length), &json!(100)));
        let features = info["features"].as_object().unwrap();
        assert!(
            features.keys().filter(|it| it.starts_with("observation.images.depth_")).count() == setup.cameras.len()
        );
        assert!(features.keys().all(|name| stats[name]["count"][0].as_u64().unwrap() > 0));
        let data = fs::File::open(path.join("data/chunk-000/file-000.parquet")).unwrap();
        let data = SerializedFileReader::new(data).unwrap();
        assert_eq!(data.metadata().file_metadata().num_rows(), length as i64);
        let last = data.get_row_iter(None).unwrap().last().unwrap().unwrap();
        let field = |name: &str| last.get_column_iter().find(|(it, _)| *it == name).unwrap().1.clone();
        assert_eq!((field("next.reward"), field("next.done")), (Field::Float(1.0), Field::Bool(true)));
        let Field::ListInternal(action) = field("action") else { panic!("a list") };
        assert_eq!(action.len(), setup.robot.dof() + 1);
        let fault = LeRobotDataset::create(&path, &setup).unwrap_err().to_string();
        assert!(fault.contains("--lerobot") && fault.contains("empty folder"), "{fault}");
    }
}
