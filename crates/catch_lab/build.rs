//! Makes cargo embed the assets anew when a file is added to them or taken away.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=../../assets");
}
