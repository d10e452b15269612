//! What values the brain's settings may have. A setting's name ends in its unit, and the unit tells the range; what is special
//! about single settings stands by name.

use std::ops::RangeInclusive;

use catch_body::InputError;

/// No count of anything may be larger: a brain that takes minutes for an image catches nothing.
const MOST: f64 = 1e5;
/// Nor any other value.
const LARGEST: f64 = 1e9;
/// Longest time, in seconds.
const LONGEST_S: f64 = 10.0;

/// All fields of a value with their paths, tables and elements of arrays included.
pub fn fields<'a>(path: &str, value: &'a toml::Value, found: &mut Vec<(String, &'a toml::Value)>) {
    let mut field = |path: String, value: &'a toml::Value| {
        fields(&path, value, found);
        found.push((path, value));
    };
    match value {
        toml::Value::Table(table) => {
            let of = |name: &String| if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
            table.iter().for_each(|(name, value)| field(of(name), value));
        }
        toml::Value::Array(values) => {
            values.iter().enumerate().for_each(|(i, value)| field(format!("{path}[{i}]"), value));
        }
        _ => {}
    }
}

/// Every setting in the table `brain` that is out of its range.
pub fn faults(file: &str, brain: &toml::Value) -> Vec<InputError> {
    let mut all = Vec::new();
    fields("brain", brain, &mut all);
    let out_of_range = |(path, value): (String, &toml::Value)| {
        let (number, range) = match value {
            toml::Value::Integer(count) => (*count as f64, counts(&path)),
            toml::Value::Float(value) => (*value, values(&path)),
            _ => return None,
        };
        let expected = match (*range.start(), *range.end()) {
            _ if range.contains(&number) => return None,
            (0.0, LARGEST) => "zero or more".to_owned(),
            (low, high) => format!("{low} to {high}"),
        };
        Some(InputError::new(file, path, value, expected))
    };
    all.into_iter().filter_map(out_of_range).collect()
}

/// The last part of a path, without the place in an array.
fn name_of(path: &str) -> &str {
    let name = path.rsplit('.').next().unwrap_or(path);
    name.split('[').next().unwrap_or(name)
}

fn counts(path: &str) -> RangeInclusive<f64> {
    match name_of(path) {
        "seed" => f64::MIN..=f64::MAX,
        "control_points" => 7.0..=40.0,
        _ => 1.0..=MOST,
    }
}

fn values(path: &str) -> RangeInclusive<f64> {
    let name = name_of(path);
    match name {
        "distance_grid_m" => 5e-4..=0.05,
        "reference_spacing_m" | "grasp_spacing_m" => 1e-4..=0.05,
        // Motions are followed in steps as long as the clearance that is left.
        "clearance_m" => 1e-3..=1.0,
        "time_step_s" | "period_s" => 1e-3..=1.0,
        "closing_speed_mps" | "closing_acceleration_mps2" => 1e-3..=LARGEST,
        "max_sideways" | "max_from_behind" => -1.0..=1.0,
        "turns_rad" => -7.0..=7.0,
        "restitution" | "tightening" => 0.0..=1.0,
        _ if name.ends_with("_share") => 0.01..=1.0,
        _ if name.ends_with("_fraction") => 0.0..=1.0,
        _ if name.ends_with("_s") => 0.0..=LONGEST_S,
        _ => 0.0..=LARGEST,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_tell_ranges() {
        let fault = |text: &str| {
            let brain = toml::Value::Table(toml::from_str(text).unwrap());
            faults("file", &brain).first().map(ToString::to_string).unwrap_or_default()
        };
        for right in ["seed = -1", "a_m = 0.0", "turns_rad = [-1.0]", "b_share = 1.0", "on = true", "c = 1"] {
            assert_eq!(fault(right), "", "{right}");
        }
        for (wrong, expected) in [
            ("[a]\nb_m = -1.0", "brain.a.b_m: found -1.0, expected zero or more"),
            ("b_share = 1.5", "brain.b_share: found 1.5, expected 0.01 to 1"),
            ("t_s = 11.0", "0 to 10"),
            ("t_s = nan", "0 to 10"),
            ("samples = 0", "1 to 100000"),
            ("turns_rad = [0.0, 8.0]", "brain.turns_rad[1]"),
        ] {
            assert!(fault(wrong).contains(expected), "{wrong}: {}", fault(wrong));
        }
    }
}
