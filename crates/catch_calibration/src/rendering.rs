//! Rendering of the arm as a camera would see it: inverse depth, surface normal and part of each pixel.

use catch_body::{
    kinematics::LinkPoses,
    ray_cast::{self, ArmSurface, SurfacePart},
};
use catch_cell::{
    CameraModel, PixelWindow,
    sight::{DepthBuffer, Sight},
};
use nalgebra::{Point2, Vector3};

/// Pixels around the arm that are looked at, too.
const MARGIN_PX: u32 = 16;

/// Intersection of one pixel's ray with the arm.
#[derive(Debug, Clone, Copy)]
pub struct Hit {
    /// 1/z in 1/m.
    pub inverse_m: f64,
    /// Outward normal in C, of length one.
    pub normal_C: Vector3<f64>,
    /// Cosine of the angle of incidence.
    pub cosine: f64,
    /// Part of the surface that was met.
    pub part: SurfacePart,
}

/// The arm as a camera sees it.
#[derive(Debug, Clone)]
pub struct Rendering<'a> {
    camera: &'a CameraModel,
    /// Parts of the surface, from near to far: those that are known to be hidden cost little.
    bodies: Vec<(SurfacePart, Sight<'a>)>,
    /// The pixels that follow: all that may show the arm, and some around them.
    pub window: PixelWindow,
    /// Intersection of each pixel's ray in the window, row by row.
    pub hits: Vec<Option<Hit>>,
}

impl<'a> Rendering<'a> {
    /// Casts a ray through the centre of each pixel that may show the arm.
    pub fn new(camera: &'a CameraModel, surface: &'a ArmSurface, X_WL: &LinkPoses, width_m: f64) -> Self {
        let sight = |(part, X_WB, surface)| (part, Sight::new(camera, &X_WB, surface));
        let mut bodies: Vec<_> = surface.named_parts(X_WL, width_m).map(sight).collect();
        bodies.retain(|(_, body)| body.window().area() > 0);
        bodies.sort_by(|(_, one), (_, two)| one.nearest_m().total_cmp(&two.nearest_m()));
        let arm = bodies.iter().filter(|(part, _)| *part != SurfacePart::Obstacle);
        let window = arm.map(|(_, body)| body.window()).reduce(|one, other| one.hull(&other)).unwrap_or_default();
        let window = window.widened(MARGIN_PX, &camera.full_window());
        let seen = DepthBuffer::new(window, bodies.iter().map(|(_, body)| *body));
        let mut rendering = Self { camera, bodies, window, hits: Vec::new() };
        let hit = |(pixel, seen): (usize, Option<_>)| Some(rendering.hit(&window.pixel_centre(pixel), seen?));
        rendering.hits = seen.pixels().enumerate().map(hit).collect();
        rendering
    }

    /// The hit of the ray through image coordinates, on a body by its number.
    fn hit(&self, uv: &Point2<f64>, (body, hit): (usize, ray_cast::Hit)) -> Hit {
        let (part, body) = &self.bodies[body];
        let (normal_C, ray_C) = (body.normal_C(hit.triangle), self.camera.back_project(uv, 1.0).coords);
        let cosine = -normal_C.dot(&ray_C) / ray_C.norm();
        Hit { inverse_m: 1.0 / hit.t, normal_C, cosine, part: *part }
    }

    /// Nearest intersection of the ray through image coordinates.
    pub fn hit_at(&self, uv: &Point2<f64>) -> Option<Hit> {
        let pixel = PixelWindow { left: uv.x as u32, top: uv.y as u32, width: 1, height: 1 };
        let may_show =
            |(_, (_, body)): &(usize, &(SurfacePart, Sight<'_>))| body.window().intersection(&pixel).area() > 0;
        let shown = self.bodies.iter().enumerate().filter(may_show);
        let nearest = shown.fold(None, |nearest: Option<(usize, ray_cast::Hit)>, (number, (_, body))| {
            let limit_m = nearest.map_or(f64::INFINITY, |(_, hit)| hit.t);
            body.at(uv, limit_m).map(|hit| (number, hit)).or(nearest)
        });
        nearest.map(|nearest| self.hit(uv, nearest))
    }

    /// Intersection of the pixel in a column and row of the window.
    pub fn at(&self, [column, row]: [usize; 2]) -> Option<&Hit> {
        self.hits[row * self.window.width as usize + column].as_ref()
    }
}
