//! The driver against the maker's protocols: `drivers/catch_franka/test` installs what they need, records
//! throws and runs this.

#![allow(non_snake_case, missing_docs)]

mod cameras;
mod doctor;
mod fake_hand;
mod faults;
mod lockstep;
mod server;
mod whole_catch;
