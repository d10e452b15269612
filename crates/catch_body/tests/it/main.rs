//! Bodies against an independent library.

mod arm_dynamics;
