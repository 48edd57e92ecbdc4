//! A path tracer in under fifty lines: explicit, with Russian roulette. `cargo run --release -p rebond-io --example fifty_lines`
use rebond::{bsdf::TransportMode::Radiance, emitter::LightSampling::Area, film::Image, math::Rgb, math::Vec3};
use rebond::{render::ShadowRay, sampling::Sampler, sampling::SamplerSettings, scene::Scene, scene::is_hit};
use {rebond_bvh::Ray, rebond_lanes::scalar::Index1};

/// One sample of the light along a ray: L(x, ωo) ≈ Le + Ld + Lind.
fn radiance(scene: &Scene, mut ray: Ray<f32>, mut random: impl FnMut() -> f32) -> Rgb<f32> {
    let (mut light, mut throughput, mut le_counts) = (Rgb::black(), Rgb::white(), true);
    loop {
        let hit = scene.intersect(&ray, true, true);
        if !is_hit(&hit) {
            return light + (throughput * scene.sky(Vec3::splat(ray.d))).masked(le_counts);
        }
        let x = scene.surface(&ray, &hit, true);
        light += (throughput * scene.emitted(&x, true)).masked(le_counts); // Le
        let bsdf = scene.bsdf(&x, &mut random, true);
        let (n, u) = (bsdf.normal(), [random(), random()]);
        if let Some(y) = scene.sample_light(x.p, n, ray.time, Area, &mut random, u, !bsdf.is_specular()) {
            let f = bsdf.eval(x.wo, y.wi, Radiance, true).f;
            let ld = throughput * f * y.weight * n.dot(y.wi).abs();
            let shadow = ShadowRay::new(&x, &y, ray.time, ld, bsdf.event(x.wo, y.wi), true);
            light += ld.masked(shadow.is_some_and(|s| !scene.occluded(&s.ray, true))); // Ld
        }
        let (u, choice, luck) = ([random(), random()], random(), random());
        let next = bsdf.sample(x.wo, u, || choice, Radiance, true);
        let survival = next.weight.max().min(0.95);
        if luck >= survival {
            return light;
        }
        throughput = throughput * next.weight * survival.recip(); // Lind: the light along the next ray,
        le_counts = next.specular; // without what Ld has counted
        ray = Ray { o: x.leave(next.w).array(), d: next.w.array(), ..ray };
    }
}

/// A picture of the size of the camera's, the mean of `spp` paths through each pixel.
pub fn render(scene: &Scene, width: u32, height: u32, spp: u32, seed: u64) -> Image {
    let sampler = Sampler::new(SamplerSettings::Independent {}, seed);
    let path = |pixel: u32, sample: u32| {
        let (stream, mut dimension) = (sampler.stream::<f32>(Index1(pixel), Index1(sample)), 0..);
        let mut random = || stream.value(Index1(dimension.next().unwrap_or(0)));
        let ([dx, dy], weight) = scene.filter().sample([random(), random()]);
        let raster = [(pixel % width) as f32 + 0.5 + dx, (pixel / width) as f32 + 0.5 + dy];
        let (eye, tmax) = (scene.camera().ray(raster, [random(), random()], random()), f32::INFINITY);
        radiance(scene, Ray { o: eye.o.array(), d: eye.d.array(), tmax, time: eye.time }, random) * weight
    };
    let mean = |pixel| (0..spp).fold(Rgb::black(), |sum, i| sum + path(pixel, i) * (spp as f32).recip()).lane(0);
    Image::from_rgb(width, height, &(0..width * height).map(mean).collect::<Vec<_>>())
}
