//! A camera path under way, and the one function that an estimator is: its [`Shade`].

use super::journal::Journal;
use super::path_classes::PathClasses;
use crate::bsdf::BsdfSample;
use crate::emitter::EmitterSample;
use crate::math::{Rgb, Vec3, offset_from_surface, vec3};
use crate::sampling::{Place, Sampler, Stream};
use crate::scene::{Scene, Surface};
use rebond_bvh::{Hit, Ray};
use rebond_lanes::{Index, Mask, Real};

/// A camera-path estimator: one bounce of it, the lecture's `shade(x)`. It traces nothing itself.
pub trait Shade: Sync {
    /// Handles what the rays of the `active` lanes hit: adds emission to the path, proposes a shadow ray with the light
    /// that it would bring, and turns the path into its next ray.
    fn shade<F: Real>(&self, scene: &Scene, path: &mut PathState<F>, hit: &Hit<F>, active: F::Mask) -> Bounce<F>;

    /// The same, its weights told to a journal by estimators that have some.
    #[inline(always)]
    fn shade_telling<F: Real>(
        &self,
        scene: &Scene,
        path: &mut PathState<F>,
        hit: &Hit<F>,
        active: F::Mask,
        journal: &mut impl Journal,
    ) -> Bounce<F> {
        let _ = journal;
        self.shade(scene, path, hit, active)
    }
}

/// What a bounce asks of the engine.
pub struct Bounce<F: Real> {
    /// Paths that go on.
    pub alive: F::Mask,
    /// What happened to them here: numbers of [`Event`](crate::bsdf::Event)s.
    pub event: F::Index,
    /// Light to be added where nothing is in its way.
    pub shadow: Option<ShadowRay<F>>,
}

impl<F: Real> Bounce<F> {
    /// No path goes on.
    pub fn end() -> Self {
        Self::last(None)
    }
    /// No path goes on, but light may come to where they are.
    pub fn last(shadow: Option<ShadowRay<F>>) -> Self {
        Self { alive: F::Mask::splat(false), event: F::Index::splat(0), shadow }
    }
}

/// A ray towards a light, and what it brings if it gets there.
pub struct ShadowRay<F: Real> {
    /// The ray, ending at the light.
    pub ray: Ray<F>,
    /// What is added to the path.
    pub contribution: Rgb<F>,
    /// What happens to the light here: numbers of [`Event`](crate::bsdf::Event)s.
    pub event: F::Index,
    /// Lanes in which it is worth tracing.
    pub mask: F::Mask,
}

impl<F: Real> ShadowRay<F> {
    /// The ray from a surface to a point on a light, both ends moved off their surfaces; `None` if no lane brings light.
    #[inline(always)]
    pub fn new(
        surface: &Surface<F>,
        light: &EmitterSample<F>,
        time: F,
        contribution: Rgb<F>,
        event: F::Index,
        mask: F::Mask,
    ) -> Option<Self> {
        let mask = mask & contribution.is_lit();
        if mask.none() {
            return None;
        }
        let o = surface.leave(light.wi);
        let target = offset_from_surface(light.point, light.error, light.normal, -light.wi);
        let d = Vec3::select(light.infinite, light.wi, target - o);
        let tmax = F::select(light.infinite, F::splat(f32::INFINITY), F::one());
        Some(Self { ray: Ray { o: o.array(), d: d.array(), tmax, time }, contribution, event, mask })
    }
}

/// Dimensions of the sample values that the camera uses; those of the bounces follow.
const CAMERA_DIMENSIONS: u32 = 3;

/// The sample values of one bounce.
pub struct Dimensions<F: Real> {
    stream: Stream<F>,
    number: F::Index,
    first: F::Index,
}

impl<F: Real> Dimensions<F> {
    /// Those of bounce `number`, of which every one uses `per_bounce` dimensions.
    #[inline(always)]
    pub fn new(stream: Stream<F>, number: F::Index, per_bounce: u32) -> Self {
        Self { stream, number, first: number * F::Index::splat(per_bounce) + F::Index::splat(CAMERA_DIMENSIONS) }
    }
    /// The same where the samples are not those of the pixel's place, but a run of their own.
    #[inline(always)]
    pub fn apart(self) -> Self {
        Self { number: F::Index::splat(u32::MAX), ..self }
    }
    /// One value in [0, 1).
    #[inline(always)]
    pub fn value(&self, n: u32) -> F {
        self.stream.value(self.first + F::Index::splat(n))
    }
    /// Two values, well spread over the square.
    #[inline(always)]
    pub fn pair(&self, n: u32) -> [F; 2] {
        self.stream.pair_at(self.first + F::Index::splat(n), Place::Bounce(self.number, n))
    }
}

macro_rules! path_state {
    (
        real { $($(#[$real_doc:meta])* $real:ident,)* }
        index { $($(#[$index_doc:meta])* $index:ident,)* }
    ) => {
        /// A camera path under way: all that one bounce hands on to the next, as numbers of four bytes.
        #[derive(Clone, Copy, Debug)]
        pub struct PathState<F: Real> {
            stream: Stream<F>,
            $($(#[$real_doc])* pub $real: F,)*
            $($(#[$index_doc])* pub $index: F::Index,)*
        }

        /// Numbers per path.
        pub(super) const FIELDS: usize = [$(stringify!($real),)* $(stringify!($index),)*].len();

        impl<F: Real> PathState<F> {
            /// Reads paths `at..at + LANES` from columns of `stride` numbers each.
            #[inline(always)]
            pub(super) fn load(columns: &[f32], stride: usize, at: usize, sampler: &Sampler) -> Self {
                let mut column = columns.chunks_exact(stride);
                let mut next = || F::load(&column.next().expect("a column per field")[at..]);
                $(let $real = next();)*
                $(let $index = next().to_bits();)*
                let nothing = F::Index::splat(0);
                let mut path = Self { stream: sampler.stream(nothing, nothing), $($real,)* $($index,)* };
                path.stream = sampler.stream(path.pixel, path.sample);
                path
            }

            /// Writes the paths of `mask` side by side at `at`; returns how many they are.
            #[inline(always)]
            pub(super) fn compress(&self, mask: F::Mask, columns: &mut [f32], stride: usize, at: usize) -> usize {
                let mut column = columns.chunks_exact_mut(stride);
                let mut next = || &mut column.next().expect("a column per field")[at..];
                $(self.$real.compress(mask, next());)*
                $(F::from_bits(self.$index).compress(mask, next());)*
                mask.count() as usize
            }
        }
    };
}

path_state! {
    real {
        /// Ray origin.
        ox,
        /// Ray origin.
        oy,
        /// Ray origin.
        oz,
        /// Unit ray direction.
        dx,
        /// Unit ray direction.
        dy,
        /// Unit ray direction.
        dz,
        /// Where it started, on the surface itself.
        fx,
        /// Where it started, on the surface itself.
        fy,
        /// Where it started, on the surface itself.
        fz,
        /// Shading normal where the ray started.
        nx,
        /// Shading normal where the ray started.
        ny,
        /// Shading normal where the ray started.
        nz,
        /// Throughput: what the light that arrives now counts in the pixel.
        tr,
        /// Throughput.
        tg,
        /// Throughput.
        tb,
        /// Radiance gathered so far.
        lr,
        /// Radiance gathered so far.
        lg,
        /// Radiance gathered so far.
        lb,
        /// Density per solid angle with which the ray was drawn; ∞ if only its sampler finds it.
        pdf,
        /// Product of the squared relative indices of refraction passed.
        eta_squared,
        /// Time.
        time,
    }
    index {
        /// Segments, the present ray included.
        depth,
        /// Number of the pixel in the whole picture.
        pixel,
        /// Index of the sample.
        sample,
        /// Where the engine keeps its sum.
        slot,
        /// State of the automaton that tells classes of paths apart.
        class,
    }
}

impl<F: Real> PathState<F> {
    /// The path of a sample of the pixel at (x, y), at its first ray.
    #[inline(always)]
    pub(crate) fn start(
        scene: &Scene,
        sampler: &Sampler,
        x: F::Index,
        y: F::Index,
        pixel: F::Index,
        sample: F::Index,
        slot: F::Index,
    ) -> Self {
        Self::start_at(scene, sampler, [x, y], pixel, sample, slot, None)
    }

    /// The same at a moment of the shutter in [0, 1) that is given, or drawn.
    #[inline(always)]
    pub(crate) fn start_at(
        scene: &Scene,
        sampler: &Sampler,
        [x, y]: [F::Index; 2],
        pixel: F::Index,
        sample: F::Index,
        slot: F::Index,
        moment: Option<F>,
    ) -> Self {
        let stream = sampler.stream::<F>(pixel, sample);
        let dimension = |n: u32| F::Index::splat(n);
        let ([fx, fy], weight) = scene.filter().sample(stream.pair_at(dimension(0), Place::Pixel));
        let raster = [F::from_index(x) + 0.5 + fx, F::from_index(y) + 0.5 + fy];
        let camera = scene.camera();
        let lens = if camera.has_lens() { stream.pair_at(dimension(1), Place::Lens) } else { [F::splat(0.5); 2] };
        let drawn = || if camera.has_shutter() { stream.value(dimension(2)) } else { F::zero() };
        let moment = moment.unwrap_or_else(drawn);
        let ray = camera.ray(raster, lens, moment);
        let zero = F::zero();
        Self {
            stream,
            ox: ray.o.x,
            oy: ray.o.y,
            oz: ray.o.z,
            dx: ray.d.x,
            dy: ray.d.y,
            dz: ray.d.z,
            fx: ray.o.x,
            fy: ray.o.y,
            fz: ray.o.z,
            nx: zero,
            ny: zero,
            nz: zero,
            tr: weight,
            tg: weight,
            tb: weight,
            lr: zero,
            lg: zero,
            lb: zero,
            pdf: F::splat(f32::INFINITY),
            eta_squared: F::one(),
            time: ray.time,
            depth: F::Index::splat(1),
            pixel,
            sample,
            slot,
            class: PathClasses::start::<F>(),
        }
    }

    /// The present ray.
    #[inline(always)]
    pub fn ray(&self) -> Ray<F> {
        Ray {
            o: [self.ox, self.oy, self.oz],
            d: [self.dx, self.dy, self.dz],
            tmax: F::splat(f32::INFINITY),
            time: self.time,
        }
    }

    /// Its origin.
    #[inline(always)]
    pub fn origin(&self) -> Vec3<F> {
        vec3(self.ox, self.oy, self.oz)
    }

    /// Its unit direction.
    #[inline(always)]
    pub fn direction(&self) -> Vec3<F> {
        vec3(self.dx, self.dy, self.dz)
    }

    /// Where it started, on the surface itself. Which light was asked there hangs on this place, not on [`PathState::origin`]: close to a
    /// lamp, or on one, the choice is quite another a hair's breadth away.
    #[inline(always)]
    pub fn from(&self) -> Vec3<F> {
        vec3(self.fx, self.fy, self.fz)
    }

    /// The shading normal where it started; zero at the camera.
    #[inline(always)]
    pub fn normal(&self) -> Vec3<F> {
        vec3(self.nx, self.ny, self.nz)
    }

    /// What the light that arrives now counts.
    #[inline(always)]
    pub fn throughput(&self) -> Rgb<F> {
        Rgb::new(self.tr, self.tg, self.tb)
    }

    /// Radiance gathered so far.
    #[inline(always)]
    pub fn radiance(&self) -> Rgb<F> {
        Rgb::new(self.lr, self.lg, self.lb)
    }

    /// The sample values of this sample of the pixel.
    #[inline(always)]
    pub fn stream(&self) -> Stream<F> {
        self.stream
    }

    /// The sample values of this bounce, of which every bounce uses `per_bounce` dimensions.
    #[inline(always)]
    pub fn dimensions(&self, per_bounce: u32) -> Dimensions<F> {
        Dimensions::new(self.stream, self.depth - F::Index::splat(1), per_bounce)
    }

    /// Gathers light that arrives along the present ray.
    #[inline(always)]
    pub fn add(&mut self, light: Rgb<F>, mask: F::Mask) {
        self.add_contribution(self.throughput() * light, mask);
    }

    /// Gathers light that has been weighed by the throughput already.
    #[inline(always)]
    pub fn add_contribution(&mut self, light: Rgb<F>, mask: F::Mask) {
        self.set_radiance(self.radiance() + light.masked(mask));
    }

    /// Replaces what was gathered.
    #[inline(always)]
    pub(super) fn set_radiance(&mut self, light: Rgb<F>) {
        (self.lr, self.lg, self.lb) = (light.r, light.g, light.b);
    }

    /// Multiplies the throughput.
    #[inline(always)]
    pub fn scale(&mut self, factor: F) {
        let t = self.throughput() * factor;
        (self.tr, self.tg, self.tb) = (t.r, t.g, t.b);
    }

    /// Leaves a surface along a sampled direction, whose density is `pdf`.
    #[inline(always)]
    pub fn go(&mut self, surface: &Surface<F>, normal: Vec3<F>, next: &BsdfSample<F>, pdf: F) {
        let o = surface.leave(next.w);
        let t = self.throughput() * next.weight;
        [self.ox, self.oy, self.oz] = o.array();
        [self.dx, self.dy, self.dz] = next.w.array();
        [self.fx, self.fy, self.fz] = surface.p.array();
        [self.nx, self.ny, self.nz] = normal.array();
        (self.tr, self.tg, self.tb) = (t.r, t.g, t.b);
        self.pdf = pdf;
        self.eta_squared = self.eta_squared * next.eta * next.eta;
    }
}
