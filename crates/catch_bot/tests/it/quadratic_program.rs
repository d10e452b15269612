//! Quadratic programs.

use catch_bot::trajectory_optimization::quadratic_program::*;
use proptest::prelude::*;

fn variables() -> impl Strategy<Value = Variables> {
    prop::collection::vec(-1.0f64..1.0, MAX_VARIABLES).prop_map(|values| Variables::from_column_slice(&values))
}

proptest! {
    /// Karush–Kuhn–Tucker conditions, checked without the solver: no feasible point of a cloud around the solution is
    /// better, and the solution is feasible.
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

#[test]
fn contradictions_are_reported() {
    let row = Row::new(Variables::ith(0, 1.0));
    let bounds = [[1.0, 2.0], [0.0, 0.5]];
    let found = Hessian::new(&Square::identity()).unwrap().minimize(&Variables::zeros(), &[row; 2], &bounds, 0);
    assert_eq!(found, Err(ProgramFailure::Infeasible));
}
