//! Failures of the arithmetic, told apart from problems that have no solution.

use std::sync::atomic::{AtomicU32, Ordering};

use catch_body::quadratic_program::ProgramFailure;

/// Counts programs and factorizations that failed although nothing proved that there is no solution.
#[derive(Debug, Default)]
pub struct FailureCounter(AtomicU32);

impl FailureCounter {
    /// The solution of a program, if it has one; any failure but infeasibility is counted.
    pub fn solution<T>(&self, solved: Result<T, ProgramFailure>) -> Option<T> {
        if matches!(solved, Err(ProgramFailure::IterationLimit | ProgramFailure::Numerical)) {
            self.add_one();
        }
        solved.ok()
    }

    /// A factorization of a matrix that is positive definite but for rounding; one that failed is counted.
    pub fn factor<T>(&self, factor: Option<T>) -> Option<T> {
        if factor.is_none() {
            self.add_one();
        }
        factor
    }

    /// The failures so far.
    pub fn count(&self) -> u32 {
        self.0.load(Ordering::Relaxed)
    }

    fn add_one(&self) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn infeasible_programs_are_no_failures() {
        let counter = FailureCounter::default();
        assert_eq!(counter.solution(Ok(7)), Some(7));
        assert_eq!(counter.solution::<u8>(Err(ProgramFailure::Infeasible)), None);
        assert_eq!(counter.factor(Some(7)), Some(7));
        assert_eq!(counter.count(), 0);
        assert_eq!(counter.solution::<u8>(Err(ProgramFailure::Numerical)), None);
        assert_eq!(counter.solution::<u8>(Err(ProgramFailure::IterationLimit)), None);
        assert_eq!(counter.factor::<u8>(None), None);
        assert_eq!(counter.count(), 3);
    }
}
