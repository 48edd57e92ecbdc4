//! Times the ray queries, next to Embree 4 if its shared library is given.
//!
//! `ray_kernel [--embree LIBRARY] [--scene NAME] [--preset NAME] [--repeat N] [--side PIXELS] [--ours]
//! [--build | --curve | --ply FILE]`
//!
//! All engines trace the same rays (camera, first and second diffuse bounce, shadow), on one thread, one after the other
//! in every round; the figures are medians over the rounds, of processor time. Build times are given by
//! the clock and in processor time.
#![allow(clippy::print_stdout, clippy::print_stderr, missing_docs)]

use rebond_bvh::{Accel, BuildOptions, Geometry, Instance, MISS, Preset, Ray};
use rebond_lanes::{F32x16, Index, Mask, Real};
use std::time::Instant;

#[path = "../tests/common/mod.rs"]
mod common;
use common::{IDENTITY, Random, blob, moved, room, sub, together};

/// As in the program.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

struct Scene {
    name: &'static str,
    geometry: Geometry,
    eye: [f32; 3],
    at: [f32; 3],
    light: [f32; 3],
}

fn cornell() -> Scene {
    let walls = room(1, [-1.0; 3], [1.0; 3]);
    let mut walls = Geometry { triangles: walls.triangles[..].to_vec(), ..walls };
    // Open towards +z.
    let positions = walls.positions.clone();
    walls.triangles.retain(|t| !t.iter().all(|&i| positions[i as usize][2] == 1.0));
    let turned = |half: [f32; 3], center: [f32; 3], angle: f32| {
        let mut part = room(1, half.map(|x| -x), half);
        let positions = part.positions.clone();
        part.triangles.retain(|t| !t.iter().all(|&i| positions[i as usize][1] < 0.0));
        for p in &mut part.positions {
            let (s, c) = angle.sin_cos();
            *p = [c * p[0] + s * p[2] + center[0], p[1] + center[1], c * p[2] - s * p[0] + center[2]];
        }
        part
    };
    let light = Geometry {
        positions: vec![[-0.25, 0.99, -0.25], [0.25, 0.99, -0.25], [0.25, 0.99, 0.25], [-0.25, 0.99, 0.25]],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Default::default()
    };
    let small = turned([0.3, 0.3, 0.3], [0.33, -0.7, 0.35], 0.3);
    let tall = turned([0.3, 0.6, 0.3], [-0.33, -0.4, -0.3], -0.3);
    Scene {
        name: "cornell",
        geometry: together([walls, light, small, tall]),
        eye: [0.0, 0.0, 3.6],
        at: [0.0; 3],
        light: [0.0, 0.98, 0.0],
    }
}

fn in_room(name: &'static str, n: usize) -> Scene {
    let mut body = blob(n, 0.35);
    // Finer relief, as scans have.
    for p in &mut body.positions {
        let s = 1.0 + 0.02 * (41.0 * p[0]).sin() * (37.0 * p[1]).sin() * (43.0 * p[2]).sin();
        *p = p.map(|x| 0.6 * x * s);
    }
    let body = moved(body, [1.0; 3], [0.0, -0.2, 0.0]);
    Scene {
        name,
        geometry: together([room(1, [-1.0, -1.0, -2.5], [1.0, 1.0, 2.5]), body]),
        eye: [0.3, 0.3, 2.2],
        at: [0.0, -0.1, 0.0],
        light: [0.5, 0.95, 0.5],
    }
}

/// A terrain, blades of grass of three long triangles each, and trees.
fn land(cells: usize, blades: usize, trees: usize) -> Scene {
    let height = |x: f32, z: f32| {
        2.0 * (0.2 * x).sin() * (0.17 * z).cos()
            + 0.3 * (0.9 * x + 0.3 * z).sin()
            + 0.05 * (5.0 * x).sin() * (4.0 * z).sin()
    };
    let size = 40.0_f32;
    let mut geometry = Geometry::default();
    let at = |i: usize| size * (i as f32 / cells as f32 - 0.5);
    for i in 0..=cells {
        for j in 0..=cells {
            geometry.positions.push([at(i), height(at(i), at(j)), at(j)]);
        }
    }
    for i in 0..cells {
        for j in 0..cells {
            let a = (i * (cells + 1) + j) as u32;
            let b = a + cells as u32 + 1;
            geometry.triangles.push([a, b, b + 1]);
            geometry.triangles.push([a, b + 1, a + 1]);
        }
    }
    let mut random = Random::new(11);
    for _ in 0..blades {
        let (x, z) = (random.between(-0.5, 0.5) * size, random.between(-0.5, 0.5) * size);
        let root = [x, height(x, z), z];
        let lean = random.point([-0.25, 0.15, -0.25], [0.25, 0.5, 0.25]);
        let phi = random.between(0.0, std::f32::consts::TAU);
        let side = [0.006 * phi.cos(), 0.0, 0.006 * phi.sin()];
        let first = geometry.positions.len() as u32;
        let point = |up: f32, out: f32, s: f32| -> [f32; 3] {
            [root[0] + lean[0] * out + side[0] * s, root[1] + lean[1] * up, root[2] + lean[2] * out + side[2] * s]
        };
        geometry.positions.extend([
            point(0.0, 0.0, -1.0),
            point(0.0, 0.0, 1.0),
            point(0.6, 0.25, -0.7),
            point(0.6, 0.25, 0.7),
            point(1.0, 1.0, 0.0),
        ]);
        geometry.triangles.extend([[0, 1, 2], [1, 3, 2], [2, 3, 4]].map(|t| t.map(|i| i + first)));
    }
    let crown = blob(16, 0.6);
    for _ in 0..trees {
        let (x, z) = (random.between(-0.5, 0.5) * size, random.between(-0.5, 0.5) * size);
        let r = random.between(0.3, 0.9);
        let crown = moved(crown.clone(), [r, 1.4 * r, r], [x, height(x, z) + 2.5 * r, z]);
        let first = geometry.positions.len() as u32;
        geometry.positions.extend(crown.positions);
        geometry.triangles.extend(crown.triangles.into_iter().map(|t| t.map(|i| i + first)));
    }
    Scene { name: "land", geometry, eye: [3.0, 4.5, 19.0], at: [0.0, 0.0, 0.0], light: [30.0, 60.0, 20.0] }
}

/// The triangles as a binary PLY file, for other programs.
fn write_ply(geometry: &Geometry, path: &str) -> std::io::Result<()> {
    use std::io::Write;
    let mut file = std::io::BufWriter::new(std::fs::File::create(path)?);
    let (vertices, faces) = (geometry.positions.len(), geometry.triangles.len());
    write!(
        file,
        "ply\nformat binary_little_endian 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\n"
    )?;
    write!(file, "property float z\nelement face {faces}\nproperty list uchar int vertex_indices\nend_header\n")?;
    for x in geometry.positions.iter().flatten() {
        file.write_all(&x.to_le_bytes())?;
    }
    for corners in &geometry.triangles {
        file.write_all(&[3])?;
        for corner in corners {
            file.write_all(&corner.to_le_bytes())?;
        }
    }
    file.flush()
}

fn normalized(d: [f32; 3]) -> [f32; 3] {
    let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
    d.map(|x| x / length)
}
fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Camera rays in tiles of 4 × 4 pixels.
fn camera(scene: &Scene, side: usize) -> Vec<Ray<f32>> {
    let forward = normalized(sub(scene.at, scene.eye));
    let right = normalized(cross(forward, [0.0, 1.0, 0.0]));
    let up = cross(right, forward);
    let mut random = Random::new(7);
    let mut rays = Vec::with_capacity(side * side);
    for tile in 0..side * side / 16 {
        for pixel in 0..16 {
            let x = (tile % (side / 4) * 4 + pixel % 4) as f32 + random.unit();
            let y = (tile / (side / 4) * 4 + pixel / 4) as f32 + random.unit();
            let (x, y) = (0.6 * (2.0 * x / side as f32 - 1.0), 0.6 * (1.0 - 2.0 * y / side as f32));
            let d = normalized(std::array::from_fn(|k| forward[k] + x * right[k] + y * up[k]));
            rays.push(Ray { o: scene.eye, d, tmax: f32::INFINITY, time: 0.0 });
        }
    }
    rays
}

/// Where each ray ends, and the normal that faces it.
fn surfaces(scene: &Scene, accel: &Accel, rays: &[Ray<f32>]) -> Vec<Option<([f32; 3], [f32; 3])>> {
    rays.iter()
        .map(|ray| {
            let hit = accel.closest(ray, true, false);
            let primitive = hit.primitive.lane(0);
            (primitive != MISS).then(|| {
                let [a, b, c] =
                    scene.geometry.triangles[primitive as usize].map(|i| scene.geometry.positions[i as usize]);
                let n = normalized(cross(sub(b, a), sub(c, a)));
                let facing: f32 = (0..3).map(|k| n[k] * ray.d[k]).sum();
                let n = if facing > 0.0 { n.map(|x| -x) } else { n };
                let (u, v) = (hit.u, hit.v);
                let p: [f32; 3] = std::array::from_fn(|k| (1.0 - u - v) * a[k] + u * b[k] + v * c[k]);
                (std::array::from_fn(|k| p[k] + 1e-4 * n[k]), n)
            })
        })
        .collect()
}

fn bounces(surfaces: &[Option<([f32; 3], [f32; 3])>], seed: u64) -> Vec<Ray<f32>> {
    let mut random = Random::new(seed);
    surfaces
        .iter()
        .flatten()
        .map(|&(o, n)| {
            let s = random.direction();
            Ray { o, d: normalized(std::array::from_fn(|k| n[k] * 1.0001 + s[k])), tmax: f32::INFINITY, time: 0.0 }
        })
        .collect()
}

fn shadows(scene: &Scene, surfaces: &[Option<([f32; 3], [f32; 3])>]) -> Vec<Ray<f32>> {
    let mut random = Random::new(99);
    surfaces
        .iter()
        .flatten()
        .map(|&(o, _)| {
            let light = random.point(scene.light.map(|x| x - 0.2), scene.light.map(|x| x + 0.2));
            Ray { o, d: sub(light, o), tmax: 0.999, time: 0.0 }
        })
        .collect()
}

fn packed(rays: &[Ray<f32>]) -> Vec<Ray<F32x16>> {
    rays.chunks_exact(16)
        .map(|group| {
            let lanes =
                |f: &dyn Fn(&Ray<f32>) -> f32| F32x16::load(&std::array::from_fn::<f32, 16, _>(|i| f(&group[i])));
            Ray {
                o: std::array::from_fn(|k| lanes(&|r| r.o[k])),
                d: std::array::from_fn(|k| lanes(&|r| r.d[k])),
                tmax: lanes(&|r| r.tmax),
                time: lanes(&|r| r.time),
            }
        })
        .collect()
}

mod embree {
    //! The few functions of Embree 4's C interface that are needed here.

    use super::{F32x16, Geometry, Ray, Real};
    use std::ffi::{CString, c_char, c_int, c_void};
    use std::sync::atomic::{AtomicIsize, Ordering};

    unsafe extern "C" {
        fn dlopen(name: *const c_char, flags: c_int) -> *mut c_void;
        fn dlsym(library: *mut c_void, name: *const c_char) -> *mut c_void;
    }

    static BYTES: AtomicIsize = AtomicIsize::new(0);

    extern "C" fn count(_: *mut c_void, bytes: isize, _: bool) -> bool {
        BYTES.fetch_add(bytes, Ordering::Relaxed);
        true
    }

    type Handle = *mut c_void;

    pub struct Library {
        handle: Handle,
    }

    macro_rules! function {
        ($library:expr, $name:ident: fn($($argument:ty),*) $(-> $result:ty)?) => {{
            let name = CString::new(stringify!($name)).expect("no zero byte");
            let f = $library.find(&name);
            // SAFETY: the type is that of Embree's rtcore headers.
            unsafe { std::mem::transmute::<*mut c_void, unsafe extern "C" fn($($argument),*) $(-> $result)?>(f) }
        }};
    }

    #[repr(C, align(64))]
    struct RayHit {
        o: [f32; 3],
        tnear: f32,
        d: [f32; 3],
        time: f32,
        tfar: f32,
        mask: u32,
        id: u32,
        flags: u32,
        normal: [f32; 3],
        uv: [f32; 2],
        primitive: u32,
        geometry: u32,
        instance: [u32; 14],
    }

    impl RayHit {
        fn new(ray: &Ray<f32>) -> Self {
            Self {
                o: ray.o,
                tnear: 0.0,
                d: ray.d,
                time: 0.0,
                tfar: ray.tmax,
                mask: u32::MAX,
                id: 0,
                flags: 0,
                normal: [0.0; 3],
                uv: [0.0; 2],
                primitive: u32::MAX,
                geometry: u32::MAX,
                instance: [u32::MAX; 14],
            }
        }
    }

    /// Sixteen of them, lane beside lane; a row is one of the words above.
    #[repr(C, align(64))]
    struct RayHit16 {
        words: [[u32; 16]; 40],
    }

    impl RayHit16 {
        const TFAR: usize = 8;
        const PRIMITIVE: usize = 17;

        fn new(ray: &Ray<F32x16>) -> Self {
            let mut words = [[0; 16]; 40];
            let [x, y, z] = ray.o;
            let [dx, dy, dz] = ray.d;
            let zero = F32x16::zero();
            for (words, x) in words.iter_mut().zip([x, y, z, zero, dx, dy, dz, zero, ray.tmax]) {
                let mut floats = [0.0; 16];
                x.store(&mut floats);
                *words = floats.map(f32::to_bits);
            }
            words[Self::TFAR + 1] = [u32::MAX; 16];
            words[Self::PRIMITIVE..].fill([u32::MAX; 16]);
            Self { words }
        }
    }

    /// What a query may be told; the fields that are null mean what they mean without it.
    #[repr(C)]
    struct Arguments {
        flags: u32,
        features: u32,
        nothing: [*const c_void; 8],
    }

    impl Arguments {
        /// Whether rays may be expected to stay together.
        fn new(coherent: bool) -> Self {
            Self { flags: u32::from(coherent) << 16, features: u32::MAX, nothing: [std::ptr::null(); 8] }
        }
    }

    /// All of sixteen rays.
    #[repr(C, align(64))]
    struct All([i32; 16]);

    static ALL: All = All([-1; 16]);

    type Query16 = unsafe extern "C" fn(*const All, Handle, *mut RayHit16, *const Arguments);

    pub struct Scene {
        scene: Handle,
        intersect: unsafe extern "C" fn(Handle, *mut RayHit, *const c_void),
        occluded: unsafe extern "C" fn(Handle, *mut RayHit, *const c_void),
        intersect16: Query16,
        occluded16: Query16,
        pub seconds: (f64, f64),
        pub bytes: isize,
    }

    impl Library {
        pub fn open(path: &str) -> Self {
            let name = CString::new(path).expect("no zero byte");
            // SAFETY: loading Embree runs nothing but its initialisers.
            let handle = unsafe { dlopen(name.as_ptr(), 2) };
            assert!(!handle.is_null(), "cannot load {path}");
            Self { handle }
        }

        fn find(&self, name: &std::ffi::CStr) -> *mut c_void {
            // SAFETY: the library is open.
            let f = unsafe { dlsym(self.handle, name.as_ptr()) };
            assert!(!f.is_null(), "{name:?} is not there");
            f
        }

        /// quality: 0 low, 1 medium, 2 high.
        pub fn build(&self, geometry: &Geometry, quality: c_int, robust: bool, threads: usize) -> Scene {
            let config = CString::new(format!("threads={threads}")).expect("no zero byte");
            let new_device = function!(self, rtcNewDevice: fn(*const c_char) -> Handle);
            let monitor = function!(self, rtcSetDeviceMemoryMonitorFunction:
                fn(Handle, extern "C" fn(*mut c_void, isize, bool) -> bool, *mut c_void));
            let new_scene = function!(self, rtcNewScene: fn(Handle) -> Handle);
            let set_quality = function!(self, rtcSetSceneBuildQuality: fn(Handle, c_int));
            let set_flags = function!(self, rtcSetSceneFlags: fn(Handle, c_int));
            let new_geometry = function!(self, rtcNewGeometry: fn(Handle, c_int) -> Handle);
            let buffer = function!(self, rtcSetSharedGeometryBuffer:
                fn(Handle, c_int, u32, c_int, *const c_void, usize, usize, usize));
            let commit_geometry = function!(self, rtcCommitGeometry: fn(Handle));
            let attach = function!(self, rtcAttachGeometry: fn(Handle, Handle) -> u32);
            let commit = function!(self, rtcCommitScene: fn(Handle));
            let intersect = function!(self, rtcIntersect1: fn(Handle, *mut RayHit, *const c_void));
            let occluded = function!(self, rtcOccluded1: fn(Handle, *mut RayHit, *const c_void));
            let intersect16 = function!(self, rtcIntersect16:
                fn(*const All, Handle, *mut RayHit16, *const Arguments));
            let occluded16 = function!(self, rtcOccluded16:
                fn(*const All, Handle, *mut RayHit16, *const Arguments));
            // Embree reads sixteen bytes of the last vertex.
            let mut positions = geometry.positions.clone();
            positions.push([0.0; 3]);
            let positions: &'static _ = positions.leak();
            let triangles: &'static _ = geometry.triangles.clone().leak();
            // SAFETY: the calls follow Embree's manual; the buffers live for ever.
            unsafe {
                let device = new_device(config.as_ptr());
                BYTES.store(0, Ordering::Relaxed);
                monitor(device, count, std::ptr::null_mut());
                let start = (std::time::Instant::now(), super::all_processor_time());
                let scene = new_scene(device);
                set_quality(scene, quality);
                set_flags(scene, if robust { 4 } else { 0 });
                let mesh = new_geometry(device, 0);
                buffer(mesh, 1, 0, 0x9003, positions.as_ptr().cast(), 0, 12, positions.len() - 1);
                buffer(mesh, 0, 0, 0x5003, triangles.as_ptr().cast(), 0, 12, triangles.len());
                commit_geometry(mesh);
                attach(scene, mesh);
                commit(scene);
                Scene {
                    scene,
                    intersect,
                    occluded,
                    intersect16,
                    occluded16,
                    seconds: (start.0.elapsed().as_secs_f64(), super::all_processor_time() - start.1),
                    bytes: BYTES.load(Ordering::Relaxed),
                }
            }
        }
    }

    impl Scene {
        pub fn closest(&self, ray: &Ray<f32>) -> u32 {
            let mut hit = RayHit::new(ray);
            // SAFETY: the scene is committed, the structure is aligned and large enough for Embree's.
            unsafe { (self.intersect)(self.scene, &raw mut hit, std::ptr::null()) };
            hit.primitive
        }
        pub fn occluded(&self, ray: &Ray<f32>) -> bool {
            let mut hit = RayHit::new(ray);
            // SAFETY: as above.
            unsafe { (self.occluded)(self.scene, &raw mut hit, std::ptr::null()) };
            hit.tfar < 0.0
        }
        /// How many of sixteen rays hit.
        pub fn closest16(&self, ray: &Ray<F32x16>, coherent: bool) -> usize {
            let mut hit = RayHit16::new(ray);
            // SAFETY: as above.
            unsafe { (self.intersect16)(&ALL, self.scene, &raw mut hit, &Arguments::new(coherent)) };
            hit.words[RayHit16::PRIMITIVE].iter().filter(|&&primitive| primitive != super::MISS).count()
        }
        pub fn occluded16(&self, ray: &Ray<F32x16>) -> usize {
            let mut hit = RayHit16::new(ray);
            // SAFETY: as above.
            unsafe { (self.occluded16)(&ALL, self.scene, &raw mut hit, &Arguments::new(false)) };
            hit.words[RayHit16::TFAR].iter().filter(|&&t| f32::from_bits(t) < 0.0).count()
        }
    }
}

/// Seconds of processor time of this thread, so that other programs disturb the figures less.
fn processor_time() -> f64 {
    clock(3)
}

/// Seconds of processor time of all threads.
fn all_processor_time() -> f64 {
    clock(2)
}

fn clock(which: std::ffi::c_int) -> f64 {
    #[cfg(target_os = "linux")]
    {
        unsafe extern "C" {
            fn clock_gettime(clock: std::ffi::c_int, time: *mut [i64; 2]) -> std::ffi::c_int;
        }
        let mut time = [0; 2];
        // SAFETY: 2 and 3 are CLOCK_PROCESS_CPUTIME_ID and CLOCK_THREAD_CPUTIME_ID; a timespec is two 64-bit integers on
        // 64-bit Linux.
        unsafe { clock_gettime(which, &raw mut time) };
        time[0] as f64 + time[1] as f64 * 1e-9
    }
    #[cfg(not(target_os = "linux"))]
    {
        static START: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
        let _ = which;
        START.get_or_init(Instant::now).elapsed().as_secs_f64()
    }
}

enum Engine {
    Embree(std::rc::Rc<embree::Scene>),
    Embree16(std::rc::Rc<embree::Scene>),
    Single(std::rc::Rc<Accel>),
    Packet(std::rc::Rc<Accel>),
}

struct Rays {
    single: Vec<Ray<f32>>,
    packets: Vec<Ray<F32x16>>,
    shadow: bool,
    coherent: bool,
}

impl Engine {
    /// Millions of rays a second, and how many hit.
    fn run(&self, rays: &Rays) -> (f64, usize) {
        let start = processor_time();
        let hits = match self {
            Self::Embree(scene) if rays.shadow => rays.single.iter().filter(|ray| scene.occluded(ray)).count(),
            Self::Embree(scene) => rays.single.iter().filter(|ray| scene.closest(ray) != MISS).count(),
            Self::Embree16(scene) if rays.shadow => rays.packets.iter().map(|ray| scene.occluded16(ray)).sum(),
            Self::Embree16(scene) => rays.packets.iter().map(|ray| scene.closest16(ray, rays.coherent)).sum(),
            Self::Single(accel) if rays.shadow => rays.single.iter().filter(|ray| accel.occluded(*ray, true)).count(),
            Self::Single(accel) => rays
                .single
                .iter()
                .filter(|ray| accel.closest(*ray, true, rays.coherent).primitive.lane(0) != MISS)
                .count(),
            Self::Packet(accel) => {
                let all = <F32x16 as Real>::Mask::splat(true);
                let count = |ray: &Ray<F32x16>| {
                    if rays.shadow {
                        accel.occluded(ray, all).count() as usize
                    } else {
                        let miss = <F32x16 as Real>::Index::splat(MISS);
                        accel.closest(ray, all, rays.coherent).primitive.ne(miss).count() as usize
                    }
                };
                rays.packets.iter().map(count).sum()
            }
        };
        (rays.single.len() as f64 / (processor_time() - start) / 1e6, hits)
    }
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values[values.len() / 2]
}

/// The structure, seconds by the clock and of the processor, bytes.
fn build(geometry: &Geometry, preset: Preset, threads: usize) -> (Accel, (f64, f64), u64) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    let geometry = vec![geometry.clone()];
    let instances = vec![Instance { geometry: 0, keyframes: vec![(0.0, IDENTITY)] }];
    let start = (Instant::now(), all_processor_time());
    let (accel, report) =
        pool.install(|| Accel::build(geometry, instances, &BuildOptions::with_preset(preset))).expect("a good scene");
    (accel, (start.0.elapsed().as_secs_f64(), all_processor_time() - start.1), report.bytes)
}

/// Medians of what building takes, every structure built once in every round.
fn builds(scene: &Scene, library: Option<&embree::Library>, only: Option<&String>, repeat: usize) {
    println!("\n{}: {} triangles", scene.name, scene.geometry.triangles.len());
    type Build<'a> = Box<dyn Fn() -> (f64, f64) + 'a>;
    let mut all: Vec<(String, Build)> = Vec::new();
    for threads in [1, 2] {
        let wanted = |name: &str| only.is_none_or(|only| only == name || *only == format!("{name} {threads}"));
        for (name, quality) in [("embree medium", 1), ("embree high", 2)].into_iter().filter(|(name, _)| wanted(name)) {
            if let Some(library) = library {
                let build = move || library.build(&scene.geometry, quality, false, threads).seconds;
                all.push((format!("{name} {threads}"), Box::new(build)));
            }
        }
        for (name, preset) in PRESETS.into_iter().filter(|(name, _)| wanted(name)) {
            all.push((format!("{name} {threads}"), Box::new(move || build(&scene.geometry, preset, threads).1)));
        }
    }
    let mut seconds = vec![(Vec::new(), Vec::new()); all.len()];
    for _ in 0..repeat {
        for ((_, build), seconds) in all.iter().zip(&mut seconds) {
            let (clock, processor) = build();
            seconds.0.push(clock);
            seconds.1.push(processor);
        }
    }
    println!("  {:16} {:>17} {:>21}   seconds: median and least", "", "clock", "processor");
    for ((name, _), (clock, processor)) in all.iter().zip(&mut seconds) {
        let (clock, processor) = ((median(clock), clock[0]), (median(processor), processor[0]));
        println!("  {name:16} {:8.4} {:8.4} {:12.4} {:8.4}", clock.0, clock.1, processor.0, processor.1);
    }
}

const PRESETS: [(&str, Preset); 3] =
    [("fast", Preset::Fast), ("default", Preset::Default), ("quality", Preset::Quality)];

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let value = |name: &str| arguments.iter().position(|a| a == name).and_then(|i| arguments.get(i + 1));
    let number = |name: &str, default: usize| value(name).map_or(default, |x| x.parse().expect("a number"));
    let library = value("--embree").map(|path| embree::Library::open(path));
    let only = value("--scene");
    let ours_only = arguments.iter().any(|a| a == "--ours");
    let repeat = number("--repeat", 7);
    let side = number("--side", 512);
    type Make = fn() -> Scene;
    let scenes: [(&str, Make); 4] = [
        ("cornell", cornell),
        ("bunny", || in_room("bunny", 13)),
        ("dragon", || in_room("dragon", 208)),
        ("land", || land(500, 400_000, 45)),
    ];
    if arguments.iter().any(|a| a == "--curve") {
        println!("triangles, preset, build seconds on 1 and 2 threads, bytes per triangle, camera and bounce Mrays/s");
        for n in [7, 22, 71, 224, 707] {
            let scene = in_room("curve", n);
            for (name, preset) in PRESETS {
                let (_, (_, one), _) = build(&scene.geometry, preset, 1);
                let (accel, (two, _), bytes) = build(&scene.geometry, preset, 2);
                let first = camera(&scene, side);
                let second = bounces(&surfaces(&scene, &accel, &first), 1);
                let engine = Engine::Single(std::rc::Rc::new(accel));
                let triangles = scene.geometry.triangles.len();
                let rate = |rays: Vec<Ray<f32>>| {
                    let rays = Rays { packets: packed(&rays), single: rays, shadow: false, coherent: false };
                    median(&mut (0..repeat).map(|_| engine.run(&rays).0).collect::<Vec<_>>())
                };
                let (first, second) = (rate(first), rate(second));
                let bytes = bytes as f64 / triangles as f64;
                println!("{triangles:9} {name:8} {one:8.3} {two:8.3} {bytes:6.1} {first:7.2} {second:7.2}");
            }
        }
        return;
    }
    if let Some(path) = value("--ply") {
        let (_, make) = scenes.iter().find(|scene| only.is_some_and(|name| name == scene.0)).expect("--scene NAME");
        return write_ply(&make().geometry, path).expect("a file that can be written");
    }
    if arguments.iter().any(|a| a == "--build") {
        for (_, make) in scenes.iter().filter(|scene| only.is_none_or(|name| name == scene.0)) {
            builds(&make(), library.as_ref(), value("--preset"), repeat);
        }
        return;
    }
    for (_, make) in scenes.iter().filter(|scene| only.is_none_or(|name| name == scene.0)) {
        let scene = make();
        let triangles = scene.geometry.triangles.len();
        println!("\n{}: {triangles} triangles", scene.name);
        let mut engines = Vec::new();
        let note = |name: &str, threads: usize, seconds: (f64, f64), bytes: f64| {
            println!(
                "  {name:16} built on {threads} in {:7.3} s ({:7.3} s of the processor), {:6.1} bytes a triangle",
                seconds.0,
                seconds.1,
                bytes / triangles as f64
            );
        };
        if let Some(library) = &library {
            for (name, quality, robust) in
                [("embree high", 2, false), ("embree medium", 1, false), ("embree robust", 2, true)]
            {
                if !ours_only || name == "embree high" {
                    if !robust && !ours_only {
                        let two = library.build(&scene.geometry, quality, robust, 2);
                        note(name, 2, two.seconds, two.bytes as f64);
                    }
                    let built = library.build(&scene.geometry, quality, robust, 1);
                    note(name, 1, built.seconds, built.bytes as f64);
                    let built = std::rc::Rc::new(built);
                    engines.push((name.to_owned(), Engine::Embree(built.clone())));
                    if !ours_only {
                        engines.push((format!("{name} x16"), Engine::Embree16(built)));
                    }
                }
            }
        }
        for (name, preset) in PRESETS {
            if value("--preset").is_some_and(|only| only != name) {
                continue;
            }
            if !ours_only {
                let (_, two, bytes) = build(&scene.geometry, preset, 2);
                note(name, 2, two, bytes as f64);
            }
            let (accel, one, bytes) = build(&scene.geometry, preset, 1);
            note(name, 1, one, bytes as f64);
            let accel = std::rc::Rc::new(accel);
            engines.push((name.to_owned(), Engine::Single(accel.clone())));
            engines.push((format!("{name} x16"), Engine::Packet(accel)));
        }
        let Some(accel) = engines.iter().find_map(|engine| match &engine.1 {
            Engine::Single(accel) => Some(accel.clone()),
            _ => None,
        }) else {
            continue;
        };
        let first = camera(&scene, side);
        let at_first = surfaces(&scene, &accel, &first);
        let second = bounces(&at_first, 1);
        let at_second = surfaces(&scene, &accel, &second);
        let third = bounces(&at_second, 2);
        let shadow = shadows(&scene, &at_first);
        let kinds = [
            ("camera", first, false, true),
            ("bounce 1", second, false, false),
            ("bounce 2", third, false, false),
            ("shadow", shadow, true, false),
        ]
        .map(|(name, mut single, shadow, coherent)| {
            single.truncate(single.len() / 16 * 16);
            (name, Rays { packets: packed(&single), single, shadow, coherent })
        });
        let mut rates = vec![vec![Vec::new(); kinds.len()]; engines.len()];
        let mut hits = vec![vec![0; kinds.len()]; engines.len()];
        for round in 0..=repeat {
            for (k, (_, rays)) in kinds.iter().enumerate() {
                for (e, (_, engine)) in engines.iter().enumerate() {
                    let (rate, n) = engine.run(rays);
                    hits[e][k] = n;
                    if round > 0 {
                        rates[e][k].push(rate);
                    }
                }
            }
        }
        let medians: Vec<Vec<f64>> =
            rates.iter_mut().map(|kinds| kinds.iter_mut().map(|r| median(r)).collect()).collect();
        println!(
            "  {:16}{:>20}{:>20}{:>20}{:>20}   Mrays/s (ratio to the first)",
            "", kinds[0].0, kinds[1].0, kinds[2].0, kinds[3].0
        );
        for (e, (name, _)) in engines.iter().enumerate() {
            let cells: String = (0..kinds.len())
                .map(|k| format!("{:12.2} ({:5.2})", medians[e][k], medians[e][k] / medians[0][k]))
                .collect();
            let differing: i64 = (0..kinds.len()).map(|k| (hits[e][k] as i64 - hits[0][k] as i64).abs()).sum();
            println!("  {name:16}{cells}   {differing} hits differ");
        }
    }
}
