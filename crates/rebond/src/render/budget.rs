//! Until when to render: a number of samples, a time, an error; whichever comes first.

use super::adaptive::shares;
use super::{Integrator, Observer, Pass, Rays, Region};
use crate::film::Film;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// When to stop. With no limit at all a render goes on until it is told to stop.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Budget {
    /// Samples per pixel.
    pub samples: Option<u32>,
    /// Time.
    pub time: Option<Duration>,
    /// Estimated relative error, as [`Film::relative_error`] has it.
    pub error: Option<f64>,
    /// Whether samples go where the estimated error is; `samples` is then their mean over pixels, about.
    pub adaptive: bool,
}

/// What a render did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RenderStatistics {
    /// Samples over all pixels.
    pub samples: u64,
    /// Rays traced.
    pub rays: Rays,
    /// Time it took.
    pub seconds: f64,
    /// Whether it was told to stop before its budget was used up.
    pub interrupted: bool,
}

/// Fewest samples per pixel by which an error is judged.
const FIRST_JUDGEMENT: u32 = 16;

/// Stops the render under way when its time is over.
struct Deadline<'a> {
    observer: &'a dyn Observer,
    end: Option<Instant>,
    interrupted: AtomicBool,
    /// Whether the pass is finished whatever the time: the first, so that no pixel stays empty; and those of adaptive renders,
    /// which would weigh less where they were not done, and so by what was seen before.
    whole_pass: AtomicBool,
}

impl Observer for Deadline<'_> {
    fn advance(&self, samples: u64, rays: u64) {
        self.observer.advance(samples, rays);
    }
    fn should_stop(&self) -> bool {
        if self.observer.should_stop() {
            self.interrupted.store(true, Ordering::Relaxed);
            return true;
        }
        !self.whole_pass.load(Ordering::Relaxed) && self.end.is_some_and(|end| Instant::now() >= end)
    }
}

/// Adds samples from index `first` on to a film of the region's size until the budget is used up.
pub fn render(
    integrator: &dyn Integrator,
    film: &mut Film,
    region: Region,
    first: u32,
    budget: &Budget,
    threads: usize,
    observer: &dyn Observer,
) -> RenderStatistics {
    let start = Instant::now();
    let end = budget.time.and_then(|t| start.checked_add(t));
    let deadline = Deadline { observer, end, interrupted: AtomicBool::new(false), whole_pass: AtomicBool::new(true) };
    let last = budget.samples.map_or(u32::MAX, |n| first.saturating_add(n));
    let mut statistics = RenderStatistics::default();
    let before = film.samples();
    let shared = Mutex::new(std::mem::replace(film, Film::new(0, 0)));
    let mut at = first;
    while at < last && !deadline.should_stop() {
        // Without a judgement of the error in between, all samples are one pass, unless time may cut it short: then the
        // picture should be complete at every power of two.
        let pass_end = match (budget.error, budget.time) {
            (None, None) if budget.samples.is_some() && !budget.adaptive => last,
            (_, None) => (at - first).max(FIRST_JUDGEMENT).saturating_add(at).min(last),
            _ => (at - first).max(1).saturating_add(at).min(last),
        };
        let pass_end = match end.filter(|_| budget.adaptive && at > first) {
            None => pass_end,
            // As many as there is time for, since an adaptive pass is not to be cut short.
            Some(end) => {
                let left = end.saturating_duration_since(Instant::now()).as_secs_f64();
                let affordable = left / start.elapsed().as_secs_f64() * f64::from(at - first);
                if affordable < 1.0 {
                    break;
                }
                pass_end.min(at.saturating_add(affordable as u32))
            }
        };
        let shares = budget.adaptive.then(|| {
            let film = shared.lock().unwrap_or_else(|e| e.into_inner());
            shares(&film, &region, pass_end - at)
        });
        let pass = Pass { region, samples: at..pass_end, threads, shares };
        statistics.rays.merge(&integrator.add_samples(&shared, &pass, &deadline));
        at = pass_end;
        deadline.whole_pass.store(budget.adaptive, Ordering::Relaxed);
        let film = shared.lock().unwrap_or_else(|e| e.into_inner());
        let error = film.relative_error();
        observer.pass_done(at - first, error);
        if at - first >= FIRST_JUDGEMENT && budget.error.is_some_and(|target| error <= target) {
            break;
        }
    }
    *film = shared.into_inner().unwrap_or_else(|e| e.into_inner());
    statistics.samples = film.samples() - before;
    statistics.seconds = start.elapsed().as_secs_f64();
    statistics.interrupted = deadline.interrupted.load(Ordering::Relaxed);
    statistics
}
