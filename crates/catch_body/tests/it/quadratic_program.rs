//! Quadratic programs.

use catch_body::quadratic_program::*;
use proptest::prelude::*;

fn variables() -> impl Strategy<Value = Variables> {
    prop::collection::vec(-1.0f64..1.0, MAX_VARIABLES).prop_map(|values| Variables::from_column_slice(&values))
}

proptest! {
    /// Karush–Kuhn–Tucker conditions, checked without the solver: no feasible point of a cloud around the
    /// solution is better, and the solution is feasible.
    #[test]
    fn solution_is_feasible_and_no_feasible_point_is_better(
        root in prop::collection::vec(-1.0f64..1.0, MAX_VARIABLES * MAX_VARIABLES),
        gradient in variables(),
        inside in variables(),
        normals in prop::collection::vec((variables(), 0.0f64..0.5), 1..25),
        equalities in 0usize..3,
        others in prop::collection::vec(variables(), 50),
    ) {
        let root = Square::from_column_slice(&root);
        let H = root * root.transpose() + Square::identity() * 0.1;
        // `inside` fulfils every constraint, so the program is feasible.
        let equalities = equalities.min(normals.len());
        let rows: Vec<Row> = normals.iter().map(|(a, _)| Row::new(*a)).collect();
        let bounds: Vec<Bounds> = normals.iter().enumerate().map(|(index, (a, slack))| {
            let value = a.dot(&inside);
            if index < equalities { [value; 2] } else { [value - slack, value + 3.0 * slack] }
        }).collect();
        let x = Hessian::new(&H).unwrap().minimize(&gradient, &rows, &bounds, equalities).unwrap();
        let cost = |x: &Variables| 0.5 * x.dot(&(H * x)) + gradient.dot(x);
        let fulfils = |y: &Variables, by: f64| normals.iter().zip(&bounds).all(|((a, _), [low, high])| {
            (low - by..=high + by).contains(&a.dot(y))
        });
        prop_assert!(fulfils(&x, 1e-9));
        // The segment from the solution to any feasible point must rise.
        let slope = H * x + gradient;
        for y in others.iter().map(|other| inside + other * 0.1).chain([inside]).filter(|y| fulfils(y, 1e-9)) {
            prop_assert!(slope.dot(&(y - x)) > -1e-7, "descends toward a feasible point");
            prop_assert!(cost(&y) >= cost(&x) - 1e-9);
        }
    }
}

proptest! {
    /// However badly conditioned the cost is, a program that a point is known to fulfil is not called
    /// infeasible: it is solved, or the arithmetic is said to have failed.
    #[test]
    fn bad_conditioning_is_not_taken_for_infeasibility(
        root in prop::collection::vec(-1.0f64..1.0, MAX_VARIABLES * MAX_VARIABLES),
        exponents in prop::collection::vec(-7.0f64..0.0, MAX_VARIABLES),
        gradient in variables(),
        inside in variables(),
        normals in prop::collection::vec((variables(), 0.0f64..0.5), 1..25),
    ) {
        let root = Square::from_column_slice(&root).qr().q();
        let scales = Variables::from_iterator(exponents.iter().map(|it| libm::pow(10.0_f64, 2.0 * it)));
        let H = root * Square::from_diagonal(&scales) * root.transpose();
        let H = (H + H.transpose()) * 0.5;
        let rows: Vec<Row> = normals.iter().map(|(a, _)| Row::new(*a)).collect();
        let bounds: Vec<Bounds> = normals.iter().map(|(a, slack)| {
            let value = a.dot(&inside);
            [value - slack, value + 3.0 * slack]
        }).collect();
        let Some(hessian) = Hessian::new(&H) else { return Ok(()) };
        match hessian.minimize(&gradient, &rows, &bounds, 0) {
            Ok(x) => for ((a, _), [low, high]) in normals.iter().zip(&bounds) {
                let off = (low - a.dot(&x)).max(a.dot(&x) - high);
                // Where x is huge the sum over its elements is known no better than this.
                let rounding = 1e-14 * x.norm();
                prop_assert!(off <= 1e-6 * (1.0 + low.abs().max(high.abs())) + rounding, "off by {off}");
            },
            Err(failure) => prop_assert_ne!(failure, ProgramFailure::Infeasible),
        }
    }
}

/// A cost with no curvature left in double precision along one variable.
#[test]
fn a_program_without_curvature_fails_numerically() {
    let mut H = Square::identity();
    H[(0, 0)] = 1e-30;
    let rows = [Row::new(Variables::ith(0, 1.0)), Row::new(Variables::ith(1, 1.0))];
    let bounds = [[1.0, 2.0], [3.0, 4.0]];
    let found = Hessian::new(&H).unwrap().minimize(&Variables::zeros(), &rows, &bounds, 0);
    assert_ne!(found, Err(ProgramFailure::Infeasible), "(1, 3) keeps all bounds");
}

#[test]
fn contradictions_are_reported() {
    let row = Row::new(Variables::ith(0, 1.0));
    let bounds = [[1.0, 2.0], [0.0, 0.5]];
    let found = Hessian::new(&Square::identity()).unwrap().minimize(&Variables::zeros(), &[row; 2], &bounds, 0);
    assert_eq!(found, Err(ProgramFailure::Infeasible));
}
