//! Least, most, mean and standard deviation of each feature, as `meta/stats.json` has them.

use std::collections::BTreeMap;

use serde_json::{Map, Value, json};

use super::columns::{Column, Values};

/// Moments of one number, over all frames.
#[derive(Debug, Clone, Copy)]
pub struct Moments {
    least: f64,
    most: f64,
    sum: f64,
    sum_of_squares: f64,
    count: f64,
}

impl Default for Moments {
    fn default() -> Self {
        Self { least: f64::INFINITY, most: f64::NEG_INFINITY, sum: 0.0, sum_of_squares: 0.0, count: 0.0 }
    }
}

impl Moments {
    /// Takes a value in.
    pub fn add(&mut self, value: f64) {
        self.merge(&Self { least: value, most: value, sum: value, sum_of_squares: value * value, count: 1.0 });
    }

    fn merge(&mut self, other: &Self) {
        self.least = self.least.min(other.least);
        self.most = self.most.max(other.most);
        self.sum += other.sum;
        self.sum_of_squares += other.sum_of_squares;
        self.count += other.count;
    }

    fn mean(&self) -> f64 {
        self.sum / self.count.max(1.0)
    }

    fn sd(&self) -> f64 {
        (self.sum_of_squares / self.count.max(1.0) - self.mean().powi(2)).max(0.0).sqrt()
    }
}

/// Statistics of all features.
#[derive(Debug, Default)]
pub struct Statistics {
    /// Moments of each number of a feature.
    features: BTreeMap<String, Vec<Moments>>,
    images: BTreeMap<String, Moments>,
}

impl Statistics {
    /// Takes the frames of an episode in; `images` are the moments of the features that are images.
    pub fn add(&mut self, columns: &[Column], images: &[(String, Moments)]) {
        for Column { name, values } in columns {
            let (width, numbers): (usize, Vec<f64>) = match values {
                Values::Flags(values) => (1, values.iter().map(|it| f64::from(u8::from(*it))).collect()),
                Values::Whole(values) => (1, values.iter().map(|it| *it as f64).collect()),
                Values::Numbers(values) => (1, values.iter().map(|it| f64::from(*it)).collect()),
                Values::Vectors(width, values) => (*width, values.iter().map(|it| f64::from(*it)).collect()),
                Values::Images(_) | Values::Words(_) | Values::Texts(_) => continue,
            };
            let moments = self.features.entry(name.clone()).or_insert_with(|| vec![Moments::default(); width]);
            numbers.iter().enumerate().for_each(|(i, value)| moments[i % width].add(*value));
        }
        for (name, moments) in images {
            self.images.entry(name.clone()).or_default().merge(moments);
        }
    }

    /// Returns the statistics as JSON: lists, those of images in the shape (1, 1, 1).
    pub fn document(&self) -> Value {
        let list = |moments: &[Moments], of: &dyn Fn(&Moments) -> f64| moments.iter().map(of).collect::<Vec<f64>>();
        let (mut features, mut frames) = (Map::new(), 0);
        for (name, moments) in &self.features {
            frames = moments.first().map_or(0.0, |it| it.count) as u64;
            let of = |of: &dyn Fn(&Moments) -> f64| list(moments, of);
            let feature = json!({
                "min": of(&|it| it.least), "max": of(&|it| it.most), "mean": of(&|it| it.mean()), "std": of(&|it| it.sd()),
                "count": [frames],
            });
            features.insert(name.clone(), feature);
        }
        for (name, it) in &self.images {
            let of = |value: f64| json!([[[value]]]);
            let feature = json!({
                "min": of(it.least), "max": of(it.most), "mean": of(it.mean()), "std": of(it.sd()), "count": [frames],
            });
            features.insert(name.clone(), feature);
        }
        Value::Object(features)
    }
}
