//! Covariance of what is estimated, from how much it depends on single images.
//!
//! Residuals of one image have in common what the weights do not know of: silhouettes that are modelled
//! badly, the encoders' error of the moment. Images have little in common. Without image i the estimate would
//! be δᵢ = (H − Hᵢ)⁻¹·gᵢ away, with the information H of all images and the priors, the image's information
//! Hᵢ, and its pull gᵢ at the optimum; Σ δᵢ·δᵢᵀ is the jackknife's covariance. A few dozen images do not tell
//! it along every direction. So they tell one number for each camera: how many times larger it is than that
//! of independent residuals, C = H⁻¹·(Σ Hᵢ)·H⁻¹, in the mean over the six directions of the pose, one at
//! least. What the priors leave uncertain, H⁻¹ − C, stays as it is.

use nalgebra::{DMatrix, DVector};

use super::{
    normal_equations::ImageInformation,
    parameters::{FIRST_NUISANCE, OF_CAMERA},
};

/// The solved equations of all images and the priors.
pub struct Equations {
    /// Inverse of the information of all images and priors.
    pub inverse: DMatrix<f64>,
    pub images: Vec<ImageInformation>,
    /// Change of the parameters from where the images were linearized to the optimum.
    pub change: DVector<f64>,
}

/// Covariance of the parameters of so many cameras.
pub fn of_cameras(equations: &Equations, cameras: usize) -> Option<DMatrix<f64>> {
    let Equations { inverse, images, change } = equations;
    let (size, of_cameras) = (inverse.nrows(), OF_CAMERA * cameras);
    let mut of_images = DMatrix::zeros(size, size);
    let mut jackknife = DMatrix::zeros(of_cameras, of_cameras);
    // An image may tell nothing.
    for image in images.iter().filter(|it| !it.places.is_empty()) {
        image.add_to(&mut of_images, 1.0);
        // (H − Hᵢ)⁻¹·gᵢ = H⁻¹·(I − Hᵢ·H⁻¹)⁻¹·gᵢ needs the places of the image alone.
        let places = &image.places;
        let own_inverse = DMatrix::from_fn(places.len(), places.len(), |a, b| inverse[(places[a], places[b])]);
        let without = DMatrix::identity(places.len(), places.len()) - &image.information * own_inverse;
        let pull = without.lu().solve(&image.pull_after(change))?;
        let by_places = |i: usize| places.iter().zip(pull.iter()).map(|(at, pull)| inverse[(i, *at)] * pull).sum();
        let away = DVector::from_fn(of_cameras, |i, _| by_places(i));
        jackknife.ger(1.0, &away, &away, 1.0);
    }
    let of_residuals = inverse.rows(0, of_cameras) * of_images * inverse.columns(0, of_cameras);
    let ratio = |camera: usize| {
        let part = |matrix: &DMatrix<f64>| {
            matrix.view((OF_CAMERA * camera, OF_CAMERA * camera), (FIRST_NUISANCE, FIRST_NUISANCE)).into_owned()
        };
        let (found, expected) = (part(&jackknife), part(&of_residuals));
        Some((expected.cholesky()?.solve(&found).trace() / FIRST_NUISANCE as f64).max(1.0))
    };
    let added: Vec<f64> = (0..cameras).map(|it| Some((ratio(it)? - 1.0).sqrt())).collect::<Option<_>>()?;
    let entry =
        |i: usize, j: usize| inverse[(i, j)] + of_residuals[(i, j)] * added[i / OF_CAMERA] * added[j / OF_CAMERA];
    Some(DMatrix::from_fn(of_cameras, of_cameras, entry))
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    use super::*;

    /// Images whose pulls are drawn with `factor` times the deviation that their information says, in the
    /// whole covariance over that of independent residuals.
    fn ratio(factor: f64, prior: f64) -> f64 {
        const IMAGES: usize = 300;
        let mut random = Pcg64::seed_from_u64(1);
        let mut draw = || (0..12).map(|_| random.random_range(-0.5..0.5)).sum::<f64>();
        let mut images: Vec<ImageInformation> = (0..IMAGES)
            .map(|_| {
                let rows = DMatrix::from_fn(20, OF_CAMERA, |_, _| draw());
                let residuals = DVector::from_fn(20, |_, _| factor * draw());
                let places = (0..OF_CAMERA).collect();
                let (coupling, common_information, common_pull) = (vec![0.0; OF_CAMERA], 1.0, 0.0);
                let (information, pull) = (rows.tr_mul(&rows), rows.tr_mul(&residuals));
                ImageInformation { places, information, pull, coupling, common_information, common_pull }
            })
            .collect();
        let priors = DMatrix::identity(OF_CAMERA, OF_CAMERA) * prior;
        let information = images.iter().fold(priors, |sum, it| sum + &it.information);
        let inverse = information.clone().cholesky().unwrap().inverse();
        let change = &inverse * images.iter().fold(DVector::zeros(OF_CAMERA), |sum, it| sum + &it.pull);
        // One that tells nothing changes nothing.
        let (information, pull) = (DMatrix::zeros(0, 0), DVector::zeros(0));
        let (places, coupling) = (Vec::new(), Vec::new());
        let (common_information, common_pull) = (1.0, 0.0);
        images.push(ImageInformation { places, information, pull, coupling, common_information, common_pull });
        let equations = Equations { inverse, images, change };
        of_cameras(&equations, 1).unwrap().trace() / equations.inverse.trace()
    }

    #[test]
    fn what_an_image_has_in_common_makes_the_claim_larger() {
        assert!((ratio(1.0, 1e-6) - 1.0).abs() < 0.1, "{}", ratio(1.0, 1e-6));
        assert!((ratio(3.0, 1e-6) / 9.0 - 1.0).abs() < 0.1, "{}", ratio(3.0, 1e-6));
    }

    /// A prior that tells as much as all images keeps its part of the covariance, a half; the other half
    /// becomes nine times as large.
    #[test]
    fn what_priors_leave_uncertain_stays() {
        let found = ratio(3.0, 6000.0);
        assert!((found - 5.0).abs() < 0.5, "{found}");
    }
}
