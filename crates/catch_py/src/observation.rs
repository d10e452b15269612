//! Observations of the cell as Python objects.

use std::sync::{Arc, Mutex, MutexGuard};

use catch_body::quantity;
use catch_cell::{Observation as Sensed, PixelWindow};
use numpy::{Element, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::{exceptions::PyTypeError, prelude::*};

use crate::{
    arguments::{Whole, fault, instance, locked},
    cell_state::{ArmState, GripperState, quantity},
};

/// Observation of the cell at one instant.
#[pyclass(frozen, module = "catchingbot")]
pub struct Observation {
    /// The observation as brains take it.
    pub sensed: Arc<Sensed>,
    /// Joints of the arm.
    pub dof: usize,
}

#[pymethods]
impl Observation {
    /// Observation at `time_s` on the cell's clock. `frames` are the images that have arrived since the last
    /// observation: any number, in any order, taken at `time_s` or before.
    #[new]
    #[pyo3(signature = (time_s, arm, gripper, frames=None), text_signature = "(time_s, arm, gripper, frames=())")]
    fn of_parts<'py>(
        time_s: &Bound<'py, PyAny>,
        arm: &Bound<'py, PyAny>,
        gripper: &Bound<'py, PyAny>,
        frames: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Self> {
        let time_s = quantity("time_s", time_s, &quantity::CLOCK_S)?;
        let arm: &ArmState = instance("arm", arm, "an ArmState")?;
        let gripper: &GripperState = instance("gripper", gripper, "a GripperState")?;
        let unlisted = || PyTypeError::new_err("frames: expected a list of DepthFrame");
        let one = |it: PyResult<Bound<'py, PyAny>>| {
            let frame = it?.cast_into::<DepthFrame>().map_err(|_| unlisted())?;
            let capture_s = frame.get().capture_s();
            let found = format!("one that was taken at {capture_s} s");
            let is_past = capture_s <= time_s;
            if is_past { Ok(frame) } else { Err(fault("frames", found, format!("at most time_s, {time_s} s"))) }
        };
        let frames = frames.map(|it| it.try_iter().map_err(|_| unlisted())?.map(one).collect::<PyResult<Vec<_>>>());
        let frames = frames.transpose()?.unwrap_or_default();
        // Large images are moved, not copied: from now on the frames show those of the observation.
        let is_last = |i: usize| !frames[i + 1..].iter().any(|other| other.is(&frames[i]));
        let images =
            (0..frames.len()).map(|i| if is_last(i) { frames[i].get().taken() } else { frames[i].get().copied() });
        let sensed = Sensed { time_s, arm: arm.sensed.clone(), gripper: gripper.sensed, frames: images.collect() };
        let sensed = Arc::new(sensed);
        for (i, frame) in frames.iter().enumerate() {
            *frame.get().lock() = Image::Sensed(sensed.clone(), i);
        }
        Ok(Self { sensed, dof: arm.dof })
    }

    /// The cell's clock in seconds.
    #[getter]
    fn time_s(&self) -> f64 {
        self.sensed.time_s
    }

    /// The arm as its robot controller reports it.
    #[getter]
    fn arm(&self) -> ArmState {
        ArmState { sensed: self.sensed.arm.clone(), dof: self.dof }
    }

    /// The gripper as it reports itself.
    #[getter]
    fn gripper(&self) -> GripperState {
        GripperState { sensed: self.sensed.gripper }
    }

    /// Depth images that have arrived since the last observation.
    #[getter]
    fn frames(&self) -> Vec<DepthFrame> {
        (0..self.sensed.frames.len())
            .map(|index| DepthFrame { image: Mutex::new(Image::Sensed(self.sensed.clone(), index)) })
            .collect()
    }

    fn __repr__(&self) -> String {
        format!("<Observation at {:.3} s, {} frames>", self.sensed.time_s, self.sensed.frames.len())
    }
}

/// Depths that are read at a time: 16 kB.
const PART: usize = 4096;

/// One depth image, or the window of it that was read out.
#[pyclass(frozen, module = "catchingbot")]
pub struct DepthFrame {
    image: Mutex<Image>,
}

/// Place of an image.
enum Image {
    /// In an observation, at this index.
    Sensed(Arc<Sensed>, usize),
    /// By itself.
    Alone(Box<catch_cell::DepthFrame>),
}

impl Image {
    fn frame(&self) -> &catch_cell::DepthFrame {
        match self {
            Self::Sensed(observation, index) => &observation.frames[*index],
            Self::Alone(frame) => frame,
        }
    }
}

impl DepthFrame {
    fn lock(&self) -> MutexGuard<'_, Image> {
        locked(&self.image)
    }

    /// Returns a copy of the image, as the contract has it.
    pub fn copied(&self) -> catch_cell::DepthFrame {
        self.lock().frame().clone()
    }

    /// Takes the image out, if it stands by itself; who does puts another one there.
    fn taken(&self) -> catch_cell::DepthFrame {
        match &mut *self.lock() {
            Image::Sensed(observation, index) => observation.frames[*index].clone(),
            Image::Alone(frame) => {
                let (depth_m, mask) = (std::mem::take(&mut frame.depth_m), frame.mask.take());
                catch_cell::DepthFrame { depth_m, mask, ..**frame }
            }
        }
    }

    /// Rows and columns.
    fn shape(&self) -> [usize; 2] {
        let (_, _, width, height) = self.window();
        [height as usize, width as usize]
    }
}

#[pymethods]
impl DepthFrame {
    /// An image of camera number `camera`, whose shutter closed at `capture_s` on the cell's clock: depths
    /// along the optical axis in metres, rows by columns. Zero, NaN and infinity are no depth. `window`
    /// (left, top, width, height) is the part of the image that this is, all of it if nothing is said; `mask`
    /// tells which of its pixels show the object, where the cell's sensors can tell.
    #[new]
    #[pyo3(signature = (camera, capture_s, depth_m, window=None, mask=None))]
    fn new(
        py: Python<'_>,
        camera: Whole,
        capture_s: &Bound<'_, PyAny>,
        depth_m: &Bound<'_, PyAny>,
        window: Option<&Bound<'_, PyAny>>,
        mask: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let camera = camera.checked(py, "camera", 0, quantity::CAMERA_NUMBER.most as u64)? as usize;
        let capture_s = quantity("capture_s", capture_s, &quantity::CLOCK_S)?;
        let depths: PyReadonlyArray2<'_, f32> = rows(depth_m, "depth_m", "f", "float32")?;
        let [height, width] = [0, 1].map(|axis| depths.shape()[axis]);
        let most = quantity::PIXEL.most as usize;
        if height.max(width) > most {
            return Err(fault("depth_m", format!("shape ({height}, {width})"), format!("at most {most} each")));
        }
        let window = match window {
            None => PixelWindow { left: 0, top: 0, width: width as u32, height: height as u32 },
            Some(window) => read_window(window, [width, height])?,
        };
        let depths = depths.as_slice()?;
        // Part by part, each read twice while it is in the cache: loops so simple compare several at a time.
        let (mut depth_m, mut is_negative) = (Vec::with_capacity(depths.len()), false);
        for part in depths.chunks(PART) {
            is_negative |= part.iter().fold(false, |is_negative, depth| is_negative | (*depth < 0.0));
            depth_m.extend(part.iter().map(|&it| if it > 0.0 && it < f32::INFINITY { it } else { f32::NAN }));
        }
        if is_negative {
            return Err(fault("depth_m", "one below zero", "depths of zero or more"));
        }
        let mask = mask.map(|mask| {
            let mask: PyReadonlyArray2<'_, bool> = rows(mask, "mask", "b", "bool")?;
            let [rows, columns] = [0, 1].map(|axis| mask.shape()[axis]);
            if [rows, columns] == [height, width] {
                Ok(mask.as_slice()?.to_vec())
            } else {
                Err(fault(
                    "mask",
                    format!("shape ({rows}, {columns})"),
                    format!("that of depth_m, ({height}, {width})"),
                ))
            }
        });
        let frame = catch_cell::DepthFrame { camera, capture_s, window, depth_m, mask: mask.transpose()? };
        Ok(Self { image: Mutex::new(Image::Alone(Box::new(frame))) })
    }

    /// Index of the camera in the brain's list.
    #[getter]
    fn camera(&self) -> usize {
        self.lock().frame().camera
    }

    /// Time at which the shutter closed, on the cell's clock.
    #[getter]
    fn capture_s(&self) -> f64 {
        self.lock().frame().capture_s
    }

    /// First column, first row, width and height of the window in the camera's image, in pixels.
    #[getter]
    fn window(&self) -> Window {
        window_of(&self.lock().frame().window)
    }

    /// Depth along the optical axis in metres, rows by columns; NaN where nothing was measured.
    #[getter]
    fn depth_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let depths = PyArray1::from_slice(py, &self.lock().frame().depth_m);
        depths.reshape(self.shape())
    }

    /// Mask of the pixels that show the object, where the cell's sensors have one.
    #[getter]
    fn mask<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<bool>>>> {
        let mask = self.lock().frame().mask.as_ref().map(|mask| PyArray1::from_slice(py, mask));
        mask.map(|mask| mask.reshape(self.shape())).transpose()
    }
}

/// First column, first row, width and height in pixels.
pub type Window = (u32, u32, u32, u32);

/// A window as Python has it.
pub fn window_of(window: &PixelWindow) -> Window {
    (window.left, window.top, window.width, window.height)
}

/// A window as wide and as high as an image.
fn read_window(window: &Bound<'_, PyAny>, [width, height]: [usize; 2]) -> PyResult<PixelWindow> {
    let expected = || PyTypeError::new_err("window: expected (left, top, width, height) in whole pixels");
    let found: Window = window.extract().map_err(|_| expected())?;
    let most = quantity::PIXEL.most as u32;
    let within = found.0 <= most && found.1 <= most;
    if !within || [found.2 as usize, found.3 as usize] != [width, height] {
        let expected = format!("places within {most} pixels, and the size of depth_m, {width} by {height}");
        return Err(fault("window", format!("{found:?}"), expected));
    }
    Ok(PixelWindow { left: found.0, top: found.1, width: found.2, height: found.3 })
}

/// An array of rows whose numbers are of this kind, as NumPy names kinds, as a contiguous one of the type
/// `dtype`.
fn rows<'py, T: Element>(
    value: &Bound<'py, PyAny>,
    argument: &str,
    kind: &str,
    dtype: &str,
) -> PyResult<PyReadonlyArray2<'py, T>> {
    // Most come as they are needed.
    if let Ok(array) = value.extract::<PyReadonlyArray2<'py, T>>()
        && array.is_c_contiguous()
    {
        return Ok(array);
    }
    let expected = format!("rows of {dtype}");
    let numpy = value.py().import("numpy")?;
    let wrong = |found: String| PyTypeError::new_err(format!("{argument}: found {found}, expected {expected}"));
    let array = numpy.call_method1("asarray", (value,)).map_err(|_| wrong(value.get_type().to_string()))?;
    let found: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
    if found != kind {
        return Err(wrong(format!("dtype {}", array.getattr("dtype")?)));
    }
    let axes: usize = array.getattr("ndim")?.extract()?;
    if axes != 2 {
        return Err(fault(argument, format!("{axes} axes"), expected));
    }
    // Narrowing may turn a number into infinity, which is no depth.
    numpy.call_method1("ascontiguousarray", (array, dtype))?.extract()
}
