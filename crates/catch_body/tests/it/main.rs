//! Bodies against an independent library.

mod all_arms;
mod arm_dynamics;
