//! Bodies against independent libraries.

mod all_arms;
mod arm_dynamics;
mod free_flight;
