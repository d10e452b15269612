//! A robot's URDF with shapes to look at.

use std::fmt::Write;

use catch_body::Robot;

/// The URDF with the robot's capsules as `<visual>` primitives of its links; as it is where it has visuals
/// already.
pub fn with_visuals(urdf: &str, robot: &Robot) -> String {
    if urdf.contains("<visual") {
        return urdf.to_owned();
    }
    robot.link_names().enumerate().fold(urdf.to_owned(), |urdf, (i, name)| add(&urdf, name, &visuals(robot, i)))
}

/// The capsules of a link: a ball at each end of a cylinder.
fn visuals(robot: &Robot, link: usize) -> String {
    let mut text = String::new();
    for (_, capsule) in robot.capsules.iter().filter(|(of, _)| *of == link) {
        let radius = capsule.radius;
        let (roll, pitch, yaw) = capsule.frame().rotation.euler_angles();
        let length_m = (capsule.to - capsule.from).norm();
        let ends =
            [&capsule.from, &capsule.to].map(|end| (end.coords, [0.0; 3], format!("<sphere radius=\"{radius}\"/>")));
        let cylinder = format!("<cylinder radius=\"{radius}\" length=\"{length_m}\"/>");
        let middle = (nalgebra::center(&capsule.from, &capsule.to).coords, [roll, pitch, yaw], cylinder);
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

    #[test]
    fn links_of_both_forms_take_visuals() {
        let urdf = "<robot>\n  <link name=\"a\"/>\n  <link name=\"ab\">\n    <x/>\n  </link>\n</robot>";
        let both = add(&add(urdf, "a", "<v/>"), "ab", "<w/>");
        assert_eq!(
            both,
            "<robot>\n  <link name=\"a\"><v/>\n  </link>\n  <link name=\"ab\"><w/>\n    <x/>\n  </link>\n</robot>"
        );
    }
}
