//! Bodies against independent libraries, and quadratic programs against their conditions.

mod all_arms;
mod arm_dynamics;
mod free_flight;
mod quadratic_program;
