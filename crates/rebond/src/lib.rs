//! Light transport.
#![forbid(unsafe_code)]

pub mod film;
