//! Bodies against independent libraries, quadratic programs and symmetries against their conditions.

mod all_arms;
mod arm_dynamics;
mod closing;
mod free_flight;
mod quadratic_program;
mod symmetry;
