//! Scene files and images to and from rebond's types: bytes in, values out.
#![forbid(unsafe_code)]
