//! Notes on how well an arm's capsules hold what cameras see of it.

use catch_body::{Robot, statistics::median};

/// A line on the visual shapes of the links, and on how far they are from the capsules; none without any.
pub(super) fn note_of_visuals(robot: &Robot) -> Option<String> {
    let mut inside_mm = Vec::new();
    let mut farthest = (f64::NEG_INFINITY, 0);
    for (link, visual) in &robot.visuals {
        let capsules = || robot.capsules.iter().filter(|(of, _)| of == link);
        for vertex in &visual.surface.vertices {
            let distances_mm = capsules().map(|(_, it)| it.distance_to_point(vertex) * 1e3);
            let Some(outside_mm) = distances_mm.reduce(f64::min) else { continue };
            inside_mm.push(-outside_mm);
            if outside_mm > farthest.0 {
                farthest = (outside_mm, *link);
            }
        }
    }
    let names: Vec<&str> = robot.link_names().collect();
    let with_capsules = names.iter().enumerate().filter(|(link, _)| !robot.visuals.contains_key(link));
    let as_capsules: Vec<&str> = with_capsules.map(|(_, name)| *name).collect();
    let others = if as_capsules.is_empty() {
        String::new()
    } else {
        format!("; of {} they see the capsules", as_capsules.join(", "))
    };
    let (count, (most_mm, link)) = (robot.visuals.len(), farthest);
    let fit = if most_mm > 0.05 {
        format!("up to {most_mm:.1} mm outside of their capsules ({})", names[link])
    } else {
        "inside their capsules".to_owned()
    };
    let median_mm = median(inside_mm)?;
    Some(format!("cameras see the meshes of {count} links, {fit}, {median_mm:.0} mm within in the median{others}"))
}
