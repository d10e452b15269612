//! Mismatch between objects and the images of a flight, as one statistic for all objects.

use crate::perception::ObjectPose;

/// Mismatch between one object and the images of a flight.
#[derive(Debug, Clone, Copy, Default)]
pub struct Explained {
    points: Mismatches,
    silhouette: Mismatches,
}

/// One statistic over the images that have it.
#[derive(Debug, Clone, Copy, Default)]
struct Mismatches {
    sum: f64,
    images: usize,
}

impl Mismatches {
    fn add(&mut self, mismatch: Option<f64>) {
        self.sum += mismatch.unwrap_or(0.0);
        self.images += usize::from(mismatch.is_some());
    }

    fn mean(&self) -> f64 {
        if self.images == 0 { f64::INFINITY } else { self.sum / self.images as f64 }
    }
}

impl<'a> FromIterator<&'a ObjectPose> for Explained {
    /// Mismatch of the images in which the object was found at these poses.
    fn from_iter<I: IntoIterator<Item = &'a ObjectPose>>(poses: I) -> Self {
        let mut explained = Self::default();
        for pose in poses {
            explained.points.add(pose.points_mismatch);
            explained.silhouette.add(pose.silhouette_mismatch);
        }
        explained
    }
}

/// The number of the object that explains its images best. All are compared by points or all by silhouettes:
/// by what tells of more images of the object of which it tells least, and by silhouettes where both do.
pub fn best(objects: &[(usize, Explained)]) -> Option<usize> {
    let images = |of: fn(&Explained) -> &Mismatches| objects.iter().map(|(_, it)| of(it).images).min();
    let by_points = images(|it| &it.points) > images(|it| &it.silhouette);
    let mean = |it: &Explained| if by_points { it.points.mean() } else { it.silhouette.mean() };
    objects.iter().min_by(|a, b| mean(&a.1).total_cmp(&mean(&b.1))).map(|(i, _)| *i)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use nalgebra::Point3;

    use super::*;
    use crate::{
        perception::{
            Config, PoseEstimator, Prior, ReferenceModel, SdfEstimator, View, Workspace,
            synthetic::{self, Noise, Normal, Shape},
        },
        tracker::tracks::tests::pose,
    };

    /// With hardly any noise the right object is compared by its points, while the others also use the
    /// silhouette.
    #[test]
    fn an_object_on_points_is_compared_with_one_on_silhouettes() {
        let (cameras, config) = (synthetic::flight_rig(), Config::default());
        // Bananas that differ in how much thinner one of their ends is.
        let shapes = [0.1, 0.4].map(Shape::bent);
        let references =
            shapes.each_ref().map(|shape| Arc::new(ReferenceModel::from_scan(&synthetic::scan(shape, 100))));
        for (thrown, shape) in shapes.iter().enumerate() {
            let X_WO = synthetic::pose_in_flight(&mut Normal::new(7));
            let X_WR = X_WO * references[thrown].X_RO.inverse();
            let mut objects = references.each_ref().map(|it| {
                let estimator = SdfEstimator::new(config.clone(), it.clone(), Workspace::default());
                (estimator, X_WR * it.X_RO, Vec::new())
            });
            let (mut on_points, mut on_both) = (0, 0);
            for seed in 1..6 {
                let noise = Noise::Constant(0.0002);
                let frames = synthetic::depth_frames(&cameras, shape, &X_WR, noise, &mut Normal::new(seed));
                let view = View { frames: &frames, cameras: &cameras, ..View::default() };
                for (estimator, X_WO, poses) in &mut objects {
                    let pose = estimator.estimate(&view, Prior::Pose(*X_WO)).unwrap();
                    poses.push(pose);
                    *(if pose.silhouette_mismatch.is_some() { &mut on_both } else { &mut on_points }) += 1;
                }
            }
            let explained = objects.map(|it| it.2.iter().collect::<Explained>());
            assert_eq!(best(&[(0, explained[0]), (1, explained[1])]), Some(thrown), "{explained:?}");
            assert!(on_points > 0 && on_both > 0, "{on_points} {on_both}: all of one kind");
        }
    }

    /// Means of points and of silhouettes are no measure of each other.
    #[test]
    fn what_only_some_objects_have_does_not_decide() {
        let explained = |points: &[f64], silhouettes: &[f64]| {
            let pose = |i: usize| ObjectPose {
                points_mismatch: points.get(i).copied(),
                silhouette_mismatch: silhouettes.get(i).copied(),
                ..pose(0.0, Point3::origin())
            };
            (0..5).map(pose).collect::<Vec<_>>().iter().collect::<Explained>()
        };
        let right = explained(&[4.0; 5], &[1.0]);
        let wrong = explained(&[60.0; 5], &[0.5, 3.0, 3.0, 3.0, 3.0]);
        assert_eq!(best(&[(0, wrong), (1, right)]), Some(1));
        // Without depths that show a shape there are silhouettes alone.
        let (right, wrong) = (explained(&[], &[1.0; 5]), explained(&[], &[2.0; 5]));
        assert_eq!(best(&[(0, wrong), (1, right)]), Some(1));
        assert_eq!(best(&[]), None);
    }
}
