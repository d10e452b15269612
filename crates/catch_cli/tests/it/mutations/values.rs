//! Changes values of MessagePack at random.

use rmpv::Value;

use super::mutator::Mutator;

impl Mutator {
    /// MessagePack with one value changed, removed or doubled.
    pub fn value(&mut self, value: &mut Value) {
        if self.is_idle {
            return;
        }
        let count = leaves(value);
        let mut chosen = self.below(count);
        self.change(value, &mut chosen);
    }

    fn change(&mut self, value: &mut Value, chosen: &mut usize) {
        let inner: Vec<&mut Value> = match value {
            Value::Array(list) if !list.is_empty() => list.iter_mut().collect(),
            Value::Map(entries) if !entries.is_empty() => entries.iter_mut().map(|(_, value)| value).collect(),
            leaf => return *leaf = self.strange(),
        };
        // Long lists of one kind do not get all the changes.
        let inner_leaves: Vec<usize> = inner.iter().map(|it| leaves(it)).collect();
        for (value, leaves) in inner.into_iter().zip(inner_leaves) {
            if *chosen < leaves {
                return self.change(value, chosen);
            }
            *chosen -= leaves;
        }
        match value {
            Value::Array(list) => match (self.below(3), self.below(list.len())) {
                (0, at) => drop(list.remove(at)),
                (1, at) => list.push(list[at].clone()),
                _ => *value = self.strange(),
            },
            Value::Map(entries) => match (self.below(3), self.below(entries.len())) {
                (0, at) => drop(entries.remove(at)),
                (1, at) => entries[at].0 = Value::from("something"),
                _ => *value = self.strange(),
            },
            _ => {}
        }
    }

    fn strange(&mut self) -> Value {
        let values = [
            Value::F64(f64::NAN),
            Value::F64(f64::INFINITY),
            Value::F64(1e300),
            Value::F64(-1e300),
            Value::F64(0.0),
            Value::F64(-1.0),
            Value::F64(1e5),
            Value::from(u64::MAX),
            Value::from(-1),
            Value::from(100_000),
            Value::from("text"),
            Value::Nil,
            Value::from(true),
            Value::Array(Vec::new()),
            Value::Array(vec![Value::from(1.5); 3]),
        ];
        let at = self.below(values.len());
        values[at].clone()
    }
}

/// Places to change in a value: itself and those within, of a long list as many as of a short one.
fn leaves(value: &Value) -> usize {
    match value {
        Value::Array(list) => 1 + list.iter().take(16).map(leaves).sum::<usize>(),
        Value::Map(entries) => 1 + entries.iter().map(|(_, value)| leaves(value)).sum::<usize>(),
        _ => 1,
    }
}
