//! Light transport.
#![forbid(unsafe_code)]

pub mod bsdf;
pub mod film;
pub mod math;
pub mod sampling;

#[cfg(test)]
mod testing;
