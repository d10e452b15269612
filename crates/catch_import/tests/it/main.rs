//! Tests of what users bring.

#![allow(non_snake_case)]

mod registration;
