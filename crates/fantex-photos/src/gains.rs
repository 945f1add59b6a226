//! The exposure of the photographs, from what several of them see of the same surface.
//!
//! Every photograph gets a factor per channel, in linear light, such that colours of the same point agree as well as possible: least
//! squares over all points and the photographs that see them, as panorama stitchers do (M. Brown and D. G. Lowe, "Automatic
//! Panoramic Image Stitching using Invariant Features", 2007), with two changes. Differences of logarithms are
//! summed, not of colours: a factor then is a summand, dark and light surfaces count alike, and factors do not
//! shrink towards zero, where all differences vanish. And large residuals count less (P. J. Huber, "Robust Estimation of a Location
//! Parameter", 1964), because highlights move with the camera and models do not fit everywhere.

use glam::Vec3;

/// One photograph's colour of a point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Observation {
    pub(crate) view: u32,
    /// Above 0.
    pub(crate) weight: f32,
    /// Linear.
    pub(crate) color: Vec3,
}

/// What is darker or lighter than this says little about the exposure.
const USABLE: std::ops::RangeInclusive<f32> = 0.004..=0.96;
/// Residuals above this, about 10 %, count less.
const HUBER: f64 = 0.1;
/// Repetitions with new weights of the residuals.
const REWEIGHTINGS: usize = 6;
/// Steps of the conjugate gradients.
const MOST_STEPS: usize = 200;
/// The pull towards 1, as a share of the mean weight of a photograph's observations.
const PULL: f64 = 1e-3;

/// The factors per photograph that make `points` agree; 1 for photographs that share nothing with others.
pub(crate) fn solve(views: usize, points: &[Vec<Observation>]) -> Vec<Vec3> {
    let channels = [0, 1, 2].map(|channel| solve_channel(views, points, channel));
    (0..views)
        .map(|view| Vec3::from([0, 1, 2].map(|channel: usize| channels[channel][view].exp() as f32)))
        .collect()
}

/// A photograph's logarithm at a point.
#[derive(Clone, Copy)]
struct Term {
    view: usize,
    log: f64,
    weight: f64,
}

fn solve_channel(views: usize, points: &[Vec<Observation>], channel: usize) -> Vec<f64> {
    let points: Vec<Vec<Term>> =
        points.iter().map(|point| terms(point, channel)).filter(|p| p.len() > 1).collect();
    let mut gains = vec![0.0; views];
    let mut robust: Vec<Vec<Term>> = points.clone();
    for _ in 0..REWEIGHTINGS {
        gains = least_squares(&robust, gains);
        for (robust, point) in robust.iter_mut().zip(&points) {
            let mean = mean_of(robust, |term| term.log + gains[term.view]);
            for (robust, term) in robust.iter_mut().zip(point) {
                let residual = (term.log + gains[term.view] - mean).abs();
                robust.weight = term.weight * (HUBER / residual.max(HUBER));
            }
        }
    }
    gains
}

/// What can be used of a point's observations, with weights relative to the best.
fn terms(point: &[Observation], channel: usize) -> Vec<Term> {
    let largest = point.iter().map(|o| o.weight).fold(0.0, f32::max);
    let usable = point.iter().filter(|o| USABLE.contains(&o.color[channel]) && o.weight > 0.0);
    let term = |o: &Observation| Term {
        view: o.view as usize,
        log: f64::from(o.color[channel]).ln(),
        // The root brings weights closer together: views that are not the best measure exposure nearly as well.
        weight: f64::from(o.weight / largest).sqrt().max(1e-3),
    };
    usable.map(term).collect()
}

fn mean_of(point: &[Term], value: impl Fn(&Term) -> f64) -> f64 {
    let weight: f64 = point.iter().map(|term| term.weight).sum();
    point.iter().map(|term| term.weight * value(term)).sum::<f64>() / weight
}

/// The minimum of the sum over points of `weight (log + gain - mean)^2`, by conjugate gradients (M. Hestenes and E. Stiefel, 1952);
/// the means have been eliminated.
fn least_squares(points: &[Vec<Term>], start: Vec<f64>) -> Vec<f64> {
    let views = start.len();
    let total: f64 = points.iter().flatten().map(|term| term.weight).sum();
    let pull = PULL * total / views.max(1) as f64 + f64::MIN_POSITIVE;
    let apply = |x: &[f64]| {
        let mut y: Vec<f64> = x.iter().map(|x| pull * x).collect();
        for point in points {
            let mean = mean_of(point, |term| x[term.view]);
            point.iter().for_each(|term| y[term.view] += term.weight * (x[term.view] - mean));
        }
        y
    };
    let mut right = vec![0.0; views];
    for point in points {
        let mean = mean_of(point, |term| term.log);
        point.iter().for_each(|term| right[term.view] -= term.weight * (term.log - mean));
    }
    conjugate_gradients(apply, &right, start, MOST_STEPS, 1e-9)
}

/// Solves a symmetric, positive definite system.
pub(crate) fn conjugate_gradients(
    apply: impl Fn(&[f64]) -> Vec<f64>,
    right: &[f64],
    start: Vec<f64>,
    most_steps: usize,
    tolerance: f64,
) -> Vec<f64> {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut x = start;
    let mut residual: Vec<f64> = right.iter().zip(apply(&x)).map(|(b, ax)| b - ax).collect();
    let mut direction = residual.clone();
    let mut squared = dot(&residual, &residual);
    let enough = tolerance * tolerance * dot(right, right).max(squared);
    for _ in 0..most_steps {
        if squared <= enough {
            break;
        }
        let applied = apply(&direction);
        let step = squared / dot(&direction, &applied);
        if !step.is_finite() {
            break;
        }
        x.iter_mut().zip(&direction).for_each(|(x, d)| *x += step * d);
        residual.iter_mut().zip(&applied).for_each(|(r, a)| *r -= step * a);
        let next = dot(&residual, &residual);
        let share = next / squared;
        direction.iter_mut().zip(&residual).for_each(|(d, r)| *d = r + share * *d);
        squared = next;
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points that each see three photographs of a ring, with known exposures and some highlights.
    fn ring(exposures: &[Vec3], highlights: bool) -> Vec<Vec<Observation>> {
        let views = exposures.len();
        (0..4000)
            .map(|i: usize| {
                let surface = Vec3::new(0.1, 0.2, 0.3) * (0.5 + (i % 17) as f32 / 17.0);
                let color = |view: usize, k: usize| {
                    let shine = if highlights && (i + k).is_multiple_of(13) { 1.7 } else { 1.0 };
                    surface * exposures[view] * shine
                };
                (0..3)
                    .map(|k| {
                        let view = (i + k) % views;
                        Observation { view: view as u32, weight: 1.0 / (1 + k) as f32, color: color(view, k) }
                    })
                    .collect()
            })
            .collect()
    }

    #[test]
    fn gains_undo_exposures_up_to_a_common_factor() {
        let exposures: Vec<Vec3> =
            (0..12).map(|i| Vec3::new(1.0, 0.9, 1.1) * (1.0 + 0.3 * (i as f32 * 1.7).sin())).collect();
        for highlights in [false, true] {
            let gains = solve(12, &ring(&exposures, highlights));
            let products: Vec<Vec3> = gains.iter().zip(&exposures).map(|(g, e)| *g * *e).collect();
            let mean = products.iter().sum::<Vec3>() / 12.0;
            let worst = products.iter().map(|p| (*p / mean - 1.0).abs().max_element()).fold(0.0, f32::max);
            assert!(worst < if highlights { 0.02 } else { 2e-3 }, "{worst}");
            // The pull keeps the whole from drifting.
            let logs: f32 = gains.iter().map(|g| g.y.ln()).sum::<f32>() / 12.0;
            assert!(logs.abs() < 1e-3, "{logs}");
        }
    }

    #[test]
    fn photographs_that_share_nothing_stay_as_they_are() {
        assert_eq!(solve(3, &[]), vec![Vec3::ONE; 3]);
        let alone = |view: u32| vec![Observation { view, weight: 1.0, color: Vec3::splat(0.2) }];
        assert_eq!(solve(2, &[alone(0), alone(1)]), vec![Vec3::ONE; 2]);
        // Black and burnt-out points say nothing.
        let pair = |a: f32, b: f32| {
            [(0, a), (1, b)]
                .map(|(view, c)| Observation { view, weight: 1.0, color: Vec3::splat(c) })
                .to_vec()
        };
        assert_eq!(solve(2, &[pair(0.5, 1.0), pair(0.0, 0.1)]), vec![Vec3::ONE; 2]);
        let gains = solve(2, &vec![pair(0.2, 0.4); 50]);
        assert!((gains[0].x / gains[1].x - 2.0).abs() < 0.01, "{gains:?}");
    }
}
