//! An object of one's own from an OBJ file: `cargo run --release --example 02_own_object`.
//!
//! The files are in `own_object` beside this one; `catchingbot new object NAME` writes a commented one to
//! start from.

#![expect(clippy::print_stdout, reason = "examples speak to whoever runs them")]

use catch_lab::{
    referee,
    scenario::setup::{Choice, Setup},
    trial,
};

fn main() -> anyhow::Result<()> {
    let object = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/own_object/wedge.toml");
    let setup = Setup::load(&Choice { object: Some(object), ..Choice::default() })?;
    let size_mm = setup.object.mesh.aabb().size * 1e3;
    println!("{}: {:.0} × {:.0} × {:.0} mm", setup.object.name, size_mm.x, size_mm.y, size_mm.z);

    for seed in 1..=3 {
        let trial = trial::run(&setup, seed, 0, &mut |_, _| Ok(()))?;
        let verdict = referee::judge(&setup, &trial);
        match verdict.reason {
            None => println!("seed {seed}: caught"),
            Some(reason) => println!("seed {seed}: missed, {reason}"),
        }
    }
    Ok(())
}
