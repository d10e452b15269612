//! Mass properties of links, by the URDF or by `robot.toml`.

use nalgebra::Matrix3;
use serde::Deserialize;

use super::{RobotFiles, unreasoned};
use crate::{InputError, document::Node, quantity, robot::Inertia, urdf};

/// Condition on the moments of inertia of a body.
const OF_A_BODY: &str = "moments above zero, none larger than the sum of the other two";

/// Mass properties of a link that take the place of the URDF's.
#[quantity::checked(deny_unknown_fields)]
#[derive(Deserialize)]
pub(super) struct LinkFields {
    /// Mass.
    mass_kg: quantity::part_mass_kg,
    /// Centre of mass in the link's frame.
    com_m: quantity::offset_m<[f64; 3]>,
    /// Moments of inertia along the link's axes about the centre of mass: xx, yy, zz, xy, xz, yz. An object's
    /// file has another order.
    inertia_kgm2: quantity::inertia_kgm2<[f64; 6]>,
    /// True if nobody published the mass properties.
    #[serde(default)]
    assumed: bool,
    /// Reason for the assumption.
    reason: Option<String>,
}

/// The inertia that the URDF states.
pub(super) fn link_inertia(link: Node) -> Result<Inertia, InputError> {
    let inertial = link.required("inertial")?;
    let inertia = urdf::inertia(inertial, [quantity::PART_MASS_KG, quantity::INERTIA_KGM2, quantity::OFFSET_M])?;
    if !inertia.is_of_a_body() {
        let found = format!("principal moments {:?}", inertia.about_com.symmetric_eigenvalues().as_slice());
        return Err(inertial.fault_of("inertia", found, OF_A_BODY));
    }
    Ok(inertia)
}

/// The inertia that `robot.toml` states in place of the URDF's.
pub(super) fn stated_inertia(files: &RobotFiles, link: &str, fields: &LinkFields) -> Result<Inertia, InputError> {
    let &LinkFields { mass_kg, com_m, inertia_kgm2: [xx, yy, zz, xy, xz, yz], assumed, ref reason } = fields;
    if let Some(fault) = unreasoned(files, &format!("links.{link}."), assumed, reason.as_ref()) {
        return Err(fault);
    }
    let about_com = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    let inertia = Inertia { mass: mass_kg, com: com_m.into(), about_com };
    if inertia.is_of_a_body() {
        return Ok(inertia);
    }
    let found = format!("principal moments {:?}", about_com.symmetric_eigenvalues().as_slice());
    Err(InputError::new(files.toml_file, format!("links.{link}.inertia_kgm2"), found, OF_A_BODY))
}
