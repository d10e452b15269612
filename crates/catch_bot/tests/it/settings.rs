//! Ranges of settings.

use catch_bot::settings::*;

#[test]
fn what_is_out_of_range_is_named() {
    let faults = Faults::default()
        .values(&NOT_NEGATIVE, [("right_m", 0.0), ("wrong_m", -1.0)])
        .values(&LIMIT_SCALE, [("ratio", f64::NAN)])
        .options(&POSITIVE, [("unset", None), ("set", Some(0.0))])
        .lists(&ANGLE_RAD, [("angles_rad", &[-1.0, 8.0][..])])
        .counts([("none", 0), ("one", 1)]);
    let said: Vec<String> = faults.all().iter().map(ToString::to_string).collect();
    assert_eq!(
        said,
        [
            "wrong_m: found -1.0, expected zero or more",
            "ratio: found nan, expected 0.01 to 1",
            "set: found 0.0, expected 0.001 or more",
            "angles_rad[1]: found 8.0, expected -7 to 7",
            "none: found 0, expected 1 to 100000",
        ]
    );
}
