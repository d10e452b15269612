//! Numerical failures in the brain: there are none.

use catch_lab::{
    evaluation::{Cell, Evaluation},
    scenario::setup::{Choice, Setup},
};

use crate::planning::OBJECTS;

#[test]
fn no_program_fails_in_a_few_honest_throws() {
    let cell = |object| {
        let choice = Choice { scenario: Some("honest"), object: Some(object), ..Choice::default() };
        Cell::new(Setup::load(&choice).unwrap())
    };
    let evaluation = Evaluation { cells: OBJECTS.map(cell).into(), seed: 21, first: 0, trials: 4 };
    let (mut rows, mut caught) = (Vec::new(), 0);
    let ran = evaluation.run(0, 2, &mut |row, _| {
        caught += usize::from(row.verdict.caught);
        rows.push(row);
        Ok(())
    });
    ran.unwrap();
    assert!(caught > 6, "{caught} of 12 caught");
    let cells = evaluation.identity().summarize(&rows);
    let failures: Vec<u64> = cells.iter().map(|cell| cell.numerical_failures).collect();
    assert_eq!(failures, [0; 3]);
}
