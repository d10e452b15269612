//! Tests of the whole: the architecture, wrong input, reproducibility, and every object and throw.

mod frames;
mod source;
mod tidy;
