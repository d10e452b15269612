//! Whose method catches.

use std::fmt::{self, Display};

use serde::{Deserialize, Serialize};

/// Whose method catches.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// What this project makes of the paper.
    #[default]
    Ours,
    /// The paper's own, for comparison ([`paper_method`](crate::paper_method)).
    Paper,
}

impl Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Ours => "ours",
            Self::Paper => "paper",
        })
    }
}
