//! CPU times of perception and prediction, image set by image set.

use super::*;

/// CPU time of this thread in milliseconds.
fn cpu_ms() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
}

fn percentiles(mut values: Vec<f64>) -> String {
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values.get((share * values.len() as f64) as usize).copied().unwrap_or(f64::NAN);
    format!("p50 {:6.3} p99 {:6.3} max {:6.3}", at(0.5), at(0.99), values.last().copied().unwrap_or(f64::NAN))
}

/// CPU time of perception and prediction for each set of images of whole throws, in which the first is a cold start.
#[test]
#[ignore = "takes minutes"]
fn measured_times() {
    let prediction = Config { spin_prior_sd_radps: 3.0, ..Config::default() };
    let cameras = synthetic::flight_rig();
    for (name, shape) in Shape::all() {
        let reference = synthetic::reference(&shape, 200);
        for noise in NOISES {
            let config = told(noise);
            let (mut find_ms, mut predict_ms, mut whole_ms, mut cold_ms) = (vec![], vec![], vec![], vec![]);
            let (mut iterations, mut lost) = (0, 0);
            for seed in 0..12 {
                let mut normal = Normal::new(seed);
                let throw = Throw::new(seed % 2 == 1, 0.0, 0.0, &reference, &mut normal);
                let mut seen = Seen::default();
                for i in 0..40 {
                    let capture_s = 0.01 * f64::from(i);
                    let X_WS = throw.pose_at(capture_s) * reference.X_RO.inverse();
                    let mut frames = synthetic::depth_frames(&cameras, &shape, &X_WS, noise, &mut normal);
                    frames.iter_mut().for_each(|frame| frame.capture_s = capture_s);
                    let last = seen.poses.last().map(|pose| pose.X_WO);
                    let expected = seen.flight.as_ref().map(|flight| flight.pose_at(capture_s)).or(last);
                    let start = cpu_ms();
                    let found = find_object(
                        &frames,
                        &cameras,
                        &reference,
                        expected.as_ref(),
                        None,
                        &config,
                        &mut seen.workspace,
                    );
                    let between = cpu_ms();
                    let Ok(pose) = found else {
                        lost += 1;
                        continue;
                    };
                    seen.poses.push(pose);
                    let flight = predict(
                        &seen.poses,
                        seen.flight.as_ref(),
                        reference.symmetry,
                        &prediction,
                        seed,
                        &mut Default::default(),
                    );
                    let end = cpu_ms();
                    seen.flight = flight.ok().or(seen.flight.take());
                    if pose.cold_started {
                        cold_ms.push(between - start);
                    } else if i > 7 {
                        iterations += pose.iterations;
                        find_ms.push(between - start);
                        predict_ms.push(end - between);
                        whole_ms.push(end - start);
                    }
                }
            }
            println!(
                "{name:7} {:16} whole {}; iterations {:.1}, lost {lost}",
                format!("{noise:?}"),
                percentiles(whole_ms.clone()),
                iterations as f64 / whole_ms.len() as f64
            );
            println!("        perception {}", percentiles(find_ms));
            println!("        prediction {}", percentiles(predict_ms));
            println!("        cold start {} ({})", percentiles(cold_ms.clone()), cold_ms.len());
        }
    }
}
