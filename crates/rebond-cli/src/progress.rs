//! A line on standard error for renders that take longer than a second; and Ctrl-C.

use indicatif::{ProgressBar, ProgressStyle};
use rebond::render::{Budget, Observer};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Whether the user has asked to stop.
static STOP: AtomicBool = AtomicBool::new(false);

/// Makes Ctrl-C stop the render. A second one ends the program at once.
pub fn catch_interrupt() {
    // Without a handler Ctrl-C simply ends the program.
    let _ = ctrlc::set_handler(|| {
        if STOP.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    });
}

/// Whether the user has asked to stop.
pub fn is_interrupted() -> bool {
    STOP.load(Ordering::Relaxed)
}

/// Shows how a render goes.
pub struct Progress {
    bar: Option<ProgressBar>,
    budget: Budget,
    pixels: u64,
    start: Instant,
    samples: AtomicU64,
    rays: AtomicU64,
    /// Of the relative error, as bits of an f64.
    error: AtomicU64,
    shown: AtomicU64,
}

impl Progress {
    pub fn new(budget: Budget, pixels: u64, quiet: bool) -> Self {
        let bar = (!quiet).then(|| {
            let bar = ProgressBar::new(1000);
            let style =
                ProgressStyle::with_template("{bar:30} {percent:>3} %  {msg}").unwrap_or(ProgressStyle::default_bar());
            bar.set_style(style);
            bar
        });
        let (samples, rays, shown) = (AtomicU64::new(0), AtomicU64::new(0), AtomicU64::new(0));
        Self {
            bar,
            budget,
            pixels,
            start: Instant::now(),
            samples,
            rays,
            error: AtomicU64::new(f64::INFINITY.to_bits()),
            shown,
        }
    }

    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }

    /// The share of the budget used up: the furthest of samples, time and error (which falls with the root of time).
    fn share(&self, elapsed: Duration) -> f64 {
        let samples = self.samples.load(Ordering::Relaxed) as f64;
        let by_samples = self.budget.samples.map(|n| samples / (f64::from(n) * self.pixels as f64));
        let by_time = self.budget.time.map(|t| elapsed.as_secs_f64() / t.as_secs_f64());
        let error = f64::from_bits(self.error.load(Ordering::Relaxed));
        let by_error = self.budget.error.map(|e| (e / error).powi(2));
        [by_samples, by_time, by_error].into_iter().flatten().fold(0.0, f64::max).min(1.0)
    }

    fn show(&self) {
        let (Some(bar), elapsed) = (&self.bar, self.start.elapsed()) else { return };
        // From the first second on, ten times a second.
        let tick = elapsed.as_millis() as u64 / 100;
        if tick < 10 || self.shown.swap(tick, Ordering::Relaxed) == tick {
            return;
        }
        let (samples, rays) = (self.samples.load(Ordering::Relaxed), self.rays.load(Ordering::Relaxed));
        let (share, seconds) = (self.share(elapsed), elapsed.as_secs_f64());
        let error = f64::from_bits(self.error.load(Ordering::Relaxed));
        let error = if error.is_finite() { format!("  error {:.2} %", 100.0 * error) } else { String::new() };
        let left =
            if share > 0.01 { format!("  {:.0} s left", seconds * (1.0 - share) / share) } else { String::new() };
        let per_pixel = samples as f64 / self.pixels as f64;
        bar.set_position((share * 1000.0) as u64);
        bar.set_message(format!("{per_pixel:.1} spp  {:.1} M rays/s{left}{error}", rays as f64 / seconds / 1e6));
    }
}

impl Observer for Progress {
    fn advance(&self, samples: u64, rays: u64) {
        self.samples.fetch_add(samples, Ordering::Relaxed);
        self.rays.fetch_add(rays, Ordering::Relaxed);
        self.show();
    }
    fn pass_done(&self, _: u32, error: f64) {
        self.error.store(error.to_bits(), Ordering::Relaxed);
    }
    fn should_stop(&self) -> bool {
        is_interrupted()
    }
}
