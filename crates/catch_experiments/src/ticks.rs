use catch_lab::{scenario::setup::{Choice, Setup}, trial};
pub fn run(scenario: &str, seed: u64, trials: u64) {
    let mut all = Vec::new();
    for object in ["tennis_ball", "banana", "pill_bottle"] {
        let setup = Setup::load(&Choice { scenario: Some(scenario), object: Some(object), ..Choice::default() }).unwrap();
        setup.prepare();
        for index in 0..trials {
            let trial = trial::run_unobserved(&mut setup.brain(seed, index), &setup, seed, index);
            let mut seen = 0;
            for s in &trial.snapshots {
                let total: f64 = s.stage_ms.iter().filter(|it| it.0 != "perception.detection").map(|it| it.1).sum();
                if s.stage_ms.is_empty() { continue }
                seen += usize::from(s.report.as_ref().is_some_and(|r| r.pose.is_some()));
                all.push((total, object, index, s.time_s, seen, s.report.as_ref().map(|r| r.status), s.stage_ms.clone()));
            }
        }
    }
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    println!("ticks {} p50 {:.2} p90 {:.2} p99 {:.2} max {:.2}", all.len(), all[all.len() / 2].0, all[all.len() / 10].0, all[all.len() / 100].0, all[0].0);
    for it in all.iter().take(60) { println!("{:.2} {} {} t {:.2} seen {} {:?} {:?}", it.0, it.1, it.2, it.3, it.4, it.5, it.6.iter().map(|(n, m)| format!("{n} {m:.2}")).collect::<Vec<_>>()); }
    let mut names = std::collections::BTreeMap::<&str, Vec<f64>>::new();
    for it in &all { for (n, m) in &it.6 { names.entry(n).or_default().push(*m); } }
    for (n, mut v) in names { v.sort_by(f64::total_cmp); println!("{n}: n {} p50 {:.3} p90 {:.3} p99 {:.3} max {:.3}", v.len(), v[v.len()/2], v[v.len()*9/10], v[v.len()*99/100], v[v.len()-1]); }
}
