//! Tests of the whole: the architecture, every object and throw, and what the brain cannot see.

mod all_cells;
mod as_it_comes;
mod blanked;
mod calibration;
mod camera_health;
mod circles;
mod controls;
mod frames;
mod knowledge;
mod numerical_failures;
mod planning;
mod play;
mod prose;
mod random_chains;
mod recorded_tracks;
mod referee;
mod robot_controller;
mod search_passes;
mod settings;
mod source;
mod standard_terms;
mod supply_chain;
mod throw_proof;
mod throws_out_of_reach;
mod tidy;
mod workcells;
