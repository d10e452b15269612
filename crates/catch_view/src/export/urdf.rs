//! A robot's URDF with shapes to look at.

use std::fmt::Write;

use catch_body::{Pose, Robot, shape::Capsule};
use nalgebra::{Translation3, UnitQuaternion, Vector3};

/// The URDF with the robot's capsules as `<visual>` primitives of its links; as it is where it has visuals
/// already.
pub fn with_visuals(urdf: &str, robot: &Robot) -> String {
    if urdf.contains("<visual") {
        return urdf.to_owned();
    }
    let names = std::iter::once(base_link(urdf)).chain(robot.joints.iter().map(|joint| joint.link_name.clone()));
    names.enumerate().fold(urdf.to_owned(), |urdf, (i, name)| add(&urdf, &name, &visuals(robot, i)))
}

/// Name of the link that stands still: the first in the URDF.
pub fn base_link(urdf: &str) -> String {
    let name = urdf.split("<link").nth(1).and_then(|it| it.split("name=\"").nth(1)).and_then(|it| it.split('"').next());
    name.unwrap_or("base").to_owned()
}

/// The capsules of a link: a ball at each end of a cylinder.
fn visuals(robot: &Robot, link: usize) -> String {
    let mut text = String::new();
    for (_, capsule) in robot.capsules.iter().filter(|(of, _)| *of == link) {
        let radius = capsule.radius;
        let (X_LS, length_m) = segment(capsule);
        let (roll, pitch, yaw) = X_LS.rotation.euler_angles();
        let ends =
            [&capsule.from, &capsule.to].map(|end| (end.coords, [0.0; 3], format!("<sphere radius=\"{radius}\"/>")));
        let cylinder = format!("<cylinder radius=\"{radius}\" length=\"{length_m}\"/>");
        let middle = (X_LS.translation.vector, [roll, pitch, yaw], cylinder);
        for (p, [roll, pitch, yaw], shape) in ends.into_iter().chain([middle]) {
            let _ = write!(
                text,
                "\n    <visual>\n      <origin xyz=\"{} {} {}\" rpy=\"{roll} {pitch} {yaw}\"/>\n      <geometry>{shape}</geometry>\n    </visual>",
                p.x, p.y, p.z,
            );
        }
    }
    text
}

/// The segment of a capsule as a cylinder along z: its middle with its direction in the link's frame, and its
/// length in metres.
pub fn segment(capsule: &Capsule) -> (Pose, f64) {
    let along = capsule.to - capsule.from;
    // Half a turn about x where both are opposite.
    let R_LS = UnitQuaternion::rotation_between(&Vector3::z(), &along)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
    let middle = nalgebra::center(&capsule.from, &capsule.to);
    (Pose::from_parts(Translation3::from(middle.coords), R_LS), along.norm())
}

/// The URDF with `content` at the beginning of a link.
fn add(urdf: &str, link: &str, content: &str) -> String {
    let tag = urdf.match_indices("<link").map(|(at, _)| at).find_map(|at| {
        let end = at + urdf[at..].find('>')?;
        urdf[at..end].contains(&format!("name=\"{link}\"")).then_some(end)
    });
    match tag {
        None => urdf.to_owned(),
        Some(end) => match urdf[..end].strip_suffix('/') {
            Some(before) => format!("{before}>{content}\n  </link>{}", &urdf[end + 1..]),
            None => format!("{}{content}{}", &urdf[..=end], &urdf[end + 1..]),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    #[test]
    fn links_of_both_forms_take_visuals() {
        let urdf = "<robot>\n  <link name=\"a\"/>\n  <link name=\"ab\">\n    <x/>\n  </link>\n</robot>";
        assert_eq!(base_link(urdf), "a");
        let both = add(&add(urdf, "a", "<v/>"), "ab", "<w/>");
        assert_eq!(
            both,
            "<robot>\n  <link name=\"a\"><v/>\n  </link>\n  <link name=\"ab\"><w/>\n    <x/>\n  </link>\n</robot>"
        );
    }

    #[test]
    fn cylinders_lie_between_the_ends() {
        for to in [[0.1, 0.2, 0.5], [0.1, 0.2, -0.7], [0.4, -0.1, 0.3]] {
            let capsule = Capsule { from: Point3::new(0.1, 0.2, 0.3), to: Point3::from(to), radius: 0.05 };
            let (X_LS, length_m) = segment(&capsule);
            let top = X_LS * Point3::new(0.0, 0.0, length_m / 2.0);
            assert!((top - capsule.to).norm() < 1e-12, "{top} {to:?}");
        }
    }
}
