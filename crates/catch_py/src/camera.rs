//! Cameras as brains believe them to be.

use catch_body::{Pose, quantity};
use catch_cell::{CameraModel, DataSheet};
use catch_lab::assets::Kind;
use nalgebra::{Matrix3, Matrix4, Rotation3, UnitQuaternion};
use numpy::{PyArray2, ToPyArray};
use pyo3::prelude::*;

use crate::{
    arguments::{Named, Numbers, fault, input_fault},
    cell_state::quantity,
    equipment::asset,
};

/// A pinhole depth camera at a known place: z along its optical axis, x to the right, y down in the image.
#[pyclass(frozen, module = "catchingbot")]
pub struct Camera {
    /// Model of the camera, as brains take it.
    pub model: CameraModel,
}

impl From<&CameraModel> for Camera {
    fn from(model: &CameraModel) -> Self {
        Self { model: model.clone() }
    }
}

/// A pose from a 4×4 matrix.
#[allow(non_snake_case)]
pub fn pose(argument: &str, X: &[f64]) -> PyResult<Pose> {
    let X = Matrix4::from_row_slice(X);
    let R: Matrix3<f64> = X.fixed_view::<3, 3>(0, 0).into();
    let is_rigid = (R.transpose() * R - Matrix3::identity()).amax() < 1e-4 && R.determinant() > 0.0;
    let is_near = X.fixed_view::<3, 1>(0, 3).amax() <= quantity::POSE.most;
    let last = X.fixed_view::<1, 4>(3, 0);
    if !is_rigid || !is_near || (last[3] - 1.0).abs() > 1e-9 || last.fixed_view::<1, 3>(0, 0).amax() > 1e-9 {
        let expected = format!("a rotation, and a position in metres within {}", quantity::POSE.most);
        return Err(fault(argument, "another matrix", expected));
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(R));
    Ok(Pose::from_parts(X.fixed_view::<3, 1>(0, 3).into_owned().into(), rotation))
}

#[pymethods]
impl Camera {
    /// A camera with the matrix `K` of its intrinsics in pixels (3×3), where the centre of the first pixel is
    /// at (0.5, 0.5), images of `size_px` (width, height), and its pose in the world (4×4). `rate_hz` is the
    /// number of its images per second, `sheet` the name or file of its data sheet, which says what errors to
    /// expect: none if nothing is said.
    #[new]
    #[pyo3(signature = (K, size_px, X_WC, *, rate_hz=None, sheet=None))]
    #[allow(non_snake_case)]
    fn new(
        py: Python<'_>,
        K: &Bound<'_, PyAny>,
        size_px: &Bound<'_, PyAny>,
        X_WC: &Bound<'_, PyAny>,
        rate_hz: Option<&Bound<'_, PyAny>>,
        sheet: Option<Named>,
    ) -> PyResult<Self> {
        let k = Numbers::read("K", K, &[3, 3])?.values;
        let (focal_px, skewed) = (k[0], [k[1], k[3], k[6], k[7], k[8] - 1.0, k[0] - k[4]]);
        if !quantity::FOCAL_PX.contains(focal_px) || skewed.iter().any(|it| it.abs() > 1e-9 * focal_px) {
            let expected = format!("[f, 0, cx], [0, f, cy], [0, 0, 1] with f of {}", quantity::FOCAL_PX);
            return Err(fault("K", format!("{k:?}"), expected));
        }
        let [width, height] = Numbers::read("size_px", size_px, &[2])?.values[..] else { unreachable!("two numbers") };
        let is_size = |it: f64| quantity::IMAGE_PX.contains(it) && it.fract() == 0.0;
        if !is_size(width) || !is_size(height) {
            return Err(fault("size_px", format!("({width}, {height})"), format!("two of {}", quantity::IMAGE_PX)));
        }
        let centre = [k[2], k[5]];
        if let Some(far) = centre.into_iter().find(|it| !quantity::IMAGE_COORDINATE_PX.contains(*it)) {
            return Err(fault("K", format!("a principal point at {far}"), quantity::IMAGE_COORDINATE_PX));
        }
        let rate_hz = rate_hz.map(|it| quantity("rate_hz", it, &quantity::RATE_HZ)).transpose()?;
        let sheet = sheet.map(|name| {
            let file = asset(Kind::Camera, &name.text(py, "sheet")?, "sheet")?;
            DataSheet::from_toml(&file.file, &file.text).map_err(input_fault)
        });
        Ok(Self {
            model: CameraModel {
                X_WC: pose("X_WC", &Numbers::read("X_WC", X_WC, &[4, 4])?.values)?,
                width_px: width as u32,
                height_px: height as u32,
                focal_px,
                principal_px: centre,
                rate_hz,
                sheet: sheet.transpose()?,
            },
        })
    }

    /// Matrix of the intrinsics in pixels, 3×3.
    #[getter]
    #[allow(non_snake_case)]
    fn K<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        let CameraModel { focal_px: f, principal_px: [x, y], .. } = self.model;
        Matrix3::new(f, 0.0, x, 0.0, f, y, 0.0, 0.0, 1.0).to_pyarray(py)
    }

    /// Pose of the camera in the world, 4×4.
    #[getter]
    #[allow(non_snake_case)]
    fn X_WC<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        self.model.X_WC.to_homogeneous().to_pyarray(py)
    }

    /// Width and height of its images in pixels.
    #[getter]
    fn size_px(&self) -> (u32, u32) {
        (self.model.width_px, self.model.height_px)
    }

    /// Images per second, where that is known.
    #[getter]
    fn rate_hz(&self) -> Option<f64> {
        self.model.rate_hz
    }
}
