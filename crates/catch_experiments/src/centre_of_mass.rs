//! What a centre of mass beside that of uniform density costs, and what estimating it in flight is worth.

use std::{fs, path::Path};

use anyhow::{Context, Result};
use catch_lab::{
    assets::{Asset, Kind, Origin},
    referee::LEADS_S,
    scenario::setup::{Choice, Setup},
    statistics::wilson95,
};
use serde::Deserialize;
use toml::{Table as Document, Value};

use crate::{
    Findings, Options, rates,
    results::{Entry, Table},
    spread::{median, percent},
};

const LEGEND: &str = "Random throws of the scenario `honest`. The true centre of mass is beside that of uniform density, of which the brain \
knows by its scan of the shape. *Told*: `com_sd_m` of its `known.toml`. The errors are medians of the predicted position of the true \
centre of mass at the planned catch, some time before it and by the last prediction. The interval is Wilson's, 95 %.";

/// Where the files of the objects are written.
const FOLDER: &str = "target/objects";

/// What is compared.
#[derive(Debug, Deserialize)]
struct Conditions {
    object: String,
    uniform_m: [f64; 3],
    direction: [f64; 3],
    moved_m: Vec<f64>,
    com_sd_m: Vec<f64>,
}

/// Every place of the centre of mass, with what the brain is told.
pub fn run(options: &Options) -> Result<Findings> {
    let conditions: Conditions = toml::from_str(include_str!("centre_of_mass.toml")).context("centre_of_mass.toml")?;
    let asset = Asset::find(Kind::Object, &conditions.object, &Origin::Disk(".".into()), ("object", "object"))?;
    let errors = LEADS_S.map(|lead_s| format!("error {lead_s} s before, mm"));
    let columns: Vec<&str> = ["moved, mm", "told, mm", "trials", "caught, %", "from, %", "to, %"]
        .into_iter()
        .chain(errors.iter().map(String::as_str))
        .chain(["last error, mm"])
        .collect();
    let mut table = Table::new("Centre of mass", &columns);
    for &moved_m in &conditions.moved_m {
        for &com_sd_m in &conditions.com_sd_m {
            let path = written(&asset.text, &conditions, moved_m, com_sd_m)?;
            let setup = Setup::load(&Choice { scenario: Some("honest"), object: Some(&path), ..Choice::default() })?;
            let rows = rates::rows(vec![setup], options)?;
            let caught = rows.iter().filter(|row| row.verdict.caught).count();
            let [low, high] = wilson95(caught, rows.len());
            let mut entries = vec![
                Entry::Number(Some(1e3 * moved_m)),
                Entry::Number(Some(1e3 * com_sd_m)),
                Entry::Count(rows.len()),
                percent(caught, rows.len()),
                Entry::Number(Some(100.0 * low)),
                Entry::Number(Some(100.0 * high)),
            ];
            let measures = || rows.iter().map(|row| &row.verdict.measures);
            for i in 0..LEADS_S.len() {
                entries.push(median(&measures().filter_map(|it| it.prediction_errors_m[i]).collect::<Vec<_>>(), 1e3));
            }
            entries.push(median(&measures().filter_map(|it| it.prediction_error_m).collect::<Vec<_>>(), 1e3));
            table.rows.push(entries);
        }
    }
    Ok(Findings { legend: LEGEND, tables: vec![table] })
}

/// Writes the object's file with another centre of mass; returns its path.
fn written(text: &str, conditions: &Conditions, moved_m: f64, com_sd_m: f64) -> Result<String> {
    let Conditions { object, uniform_m, direction, .. } = conditions;
    let mut file: Document = toml::from_str(text).context("the object's file")?;
    let com_m = std::array::from_fn::<_, 3, _>(|i| Value::Float(uniform_m[i] + moved_m * direction[i]));
    let mut table = |name: &str, key: &str, value: Value| {
        let table = file.get_mut(name).and_then(Value::as_table_mut).with_context(|| format!("[{name}]"))?;
        table.insert(key.to_owned(), value);
        anyhow::Ok(())
    };
    table("truth", "com_m", Value::Array(com_m.to_vec()))?;
    table("known", "com_sd_m", Value::Float(com_sd_m))?;
    fs::create_dir_all(FOLDER)?;
    let path = Path::new(FOLDER).join(format!("{object}_{:.0}_{:.0}.toml", 1e3 * moved_m, 1e3 * com_sd_m));
    fs::write(&path, toml::to_string(&file)?)?;
    Ok(path.display().to_string())
}
