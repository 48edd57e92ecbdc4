//! Light transport: every classic global-illumination algorithm on one scene.
//!
//! A [`SceneDescription`](scene::SceneDescription) is plain data. [`scene::build`] makes of it an immutable
//! [`Scene`](scene::Scene). An [`IntegratorSettings`](integrators::IntegratorSettings) makes an
//! [`Integrator`](render::Integrator), which [`render::render`] runs until a [`Budget`](render::Budget) is used up, and
//! which leaves its samples in a [`Film`](film::Film).
//!
//! The library opens no file, prints nothing, and does not panic on bad input.
#![forbid(unsafe_code)]

pub mod bsdf;
pub mod camera;
pub mod compare;
pub mod emitter;
pub mod film;
pub mod integrators;
pub mod math;
pub mod render;
pub mod sampling;
pub mod scene;
pub mod shape;
pub mod texture;
pub mod transport;

#[cfg(test)]
mod testing;
