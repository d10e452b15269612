//! Correlation of neighbouring measurements, from their residuals: the number of them that count as one.

use std::collections::BTreeMap;

use super::measurement::{Measurement, Quantity};

/// Farthest neighbours that are looked at, in pixels and in lines.
const LAGS: usize = 12;
/// Correlations below this end the sum.
const LEAST: f64 = 0.02;

/// Products of residuals by how far apart they are, of one kind of measurement along one direction.
#[derive(Debug, Clone, Copy, Default)]
struct Products {
    sums: [f64; LAGS + 1],
    counts: [f64; LAGS + 1],
}

impl Products {
    fn add(&mut self, lag: usize, product: f64) {
        self.sums[lag] += product;
        self.counts[lag] += 1.0;
    }

    /// 1 + 2·Σρ.
    fn factor(&self) -> f64 {
        let mean = |lag: usize| self.sums[lag] / self.counts[lag].max(1.0);
        let variance = mean(0).max(f64::MIN_POSITIVE);
        1.0 + 2.0 * (1..=LAGS).map(|lag| mean(lag) / variance).take_while(|rho| *rho > LEAST).sum::<f64>()
    }
}

/// Residuals of one camera.
#[derive(Debug, Clone, Copy, Default)]
pub struct Correlation {
    along_rows: Products,
    along_columns: Products,
    along_silhouettes: Products,
}

impl Correlation {
    /// Adds the residuals of one image, in standard deviations.
    pub fn add(&mut self, image: &[(Measurement, f64)]) {
        let depths: BTreeMap<[i32; 2], f64> =
            image.iter().filter(|(it, _)| it.is_depth()).map(|(it, residual)| (it.place, *residual)).collect();
        for ([row, column], residual) in &depths {
            for lag in 0..=LAGS {
                let away = lag as i32;
                if let Some(other) = depths.get(&[*row, column + away]) {
                    self.along_rows.add(lag, residual * other);
                }
                if let Some(other) = depths.get(&[row + away, *column]) {
                    self.along_columns.add(lag, residual * other);
                }
            }
        }
        let mut lines: BTreeMap<(bool, i32), Vec<(i32, f64)>> = BTreeMap::new();
        for (it, residual) in image {
            if let Quantity::ShownPixels { along_row, .. } = it.quantity {
                lines.entry((along_row, it.place[0])).or_default().push((it.place[1], *residual));
            }
        }
        for ((along_row, line), crossings) in &lines {
            for lag in 0..=LAGS {
                let away = lag as i32;
                let others = lines.get(&(*along_row, line + away));
                for (last, residual) in crossings {
                    let near = others.into_iter().flatten().filter(|(other, _)| (other - last).abs() <= away);
                    near.for_each(|(_, other)| self.along_silhouettes.add(lag, residual * other));
                }
            }
        }
    }

    /// Number of neighbouring depths that count as one.
    pub fn of_depths(&self) -> f64 {
        self.along_rows.factor() * self.along_columns.factor()
    }

    /// Number of neighbouring silhouette lines that count as one.
    pub fn of_silhouettes(&self) -> f64 {
        self.along_silhouettes.factor()
    }
}
