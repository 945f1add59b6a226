//! Figures, messages, pacing and jobs.

use std::sync::mpsc;

use fantex_app::figures::{Graphs, History, RateMeter, StreamFigures};
use fantex_app::job::{Job, JobState};
use fantex_app::notices::Notices;
use fantex_app::pacing::{Draw, Pacing};

#[test]
fn shares_are_shares() {
    let mut figures = StreamFigures::default();
    assert_eq!((figures.hit_rate(), figures.occupancy()), (1.0, 0.0));
    assert!(figures.is_sharp());
    figures = StreamFigures { wanted: 4, missing: 1, pool_bytes: 100, used_bytes: 25, ..figures };
    assert_eq!((figures.hit_rate(), figures.occupancy()), (0.75, 0.25));
    assert!(!figures.is_sharp());
}

#[test]
fn bandwidth_is_per_second() {
    let mut graphs = Graphs::default();
    for i in 0..20 {
        let now = StreamFigures { uploaded_bytes: i * 1000, ..StreamFigures::default() };
        graphs.stream(i as f64 * 0.1, &now);
    }
    assert!((graphs.bandwidth.last().unwrap() - 10_000.0).abs() < 1.0);
}

#[test]
fn histories_forget_the_oldest() {
    let mut history = History::new(3);
    for value in [9.0, 1.0, f32::NAN, 2.0] {
        history.push(value);
    }
    assert_eq!(history.iter().collect::<Vec<_>>(), [1.0, 0.0, 2.0]);
    assert_eq!(history.last(), Some(2.0));
}

#[test]
fn percentiles_are_values_that_occurred() {
    let mut history = History::new(100);
    assert_eq!(history.percentile(0.5), None);
    (1..=100).for_each(|i| history.push(i as f32));
    assert_eq!(history.percentile(0.5), Some(50.0));
    assert_eq!(history.percentile(0.99), Some(99.0));
    assert_eq!(history.percentile(1.0), Some(100.0));
    assert_eq!(history.percentile(0.0), Some(1.0));
}

#[test]
fn rates_are_means_over_a_second() {
    let mut meter = RateMeter::default();
    assert_eq!(meter.update(0.0, 0.0), 0.0);
    let mut rate = 0.0;
    for i in 1..=40 {
        rate = meter.update(f64::from(i) * 0.1, f64::from(i) * 5.0);
    }
    assert!((rate - 50.0).abs() < 1e-6, "{rate}");
    assert_eq!(meter.update(4.1, 0.0), 0.0, "a count that falls starts anew");
    for i in 1..=20 {
        rate = meter.update(4.1 + f64::from(i) * 0.1, 0.0);
    }
    assert_eq!(rate, 0.0);
}

#[test]
fn nothing_is_drawn_where_nothing_changes() {
    let mut pacing = Pacing::default();
    pacing.changed();
    assert_eq!(pacing.next(0.0, true), Draw::Scaled(1.0));
    assert_eq!(pacing.next(0.1, true), Draw::Nothing, "one at a time");
    assert!(!pacing.is_settled());
    pacing.drawn(0.01);
    assert!(pacing.is_settled());
    assert_eq!(pacing.next(0.2, true), Draw::Nothing);
    assert_eq!(pacing.wake_in(0.2), None);
}

#[test]
fn slow_pictures_shrink_while_moving_and_grow_at_rest() {
    let mut pacing = Pacing::default();
    let mut seconds = 0.0;
    let mut scales = Vec::new();
    for _ in 0..20 {
        pacing.moved(seconds);
        let Draw::Scaled(scale) = pacing.next(seconds, true) else { panic!("nothing drawn") };
        scales.push(scale);
        // 100 ms in full.
        let took = 0.1 * f64::from(scale).powi(2);
        pacing.drawn(took);
        seconds += took;
    }
    assert_eq!(scales[0], 1.0);
    let last = *scales.last().unwrap();
    assert!(last < 0.61 && last > 0.4, "{scales:?}");
    assert!(!pacing.is_settled());
    let rest = pacing.wake_in(seconds).unwrap();
    assert!(rest > 0.0 && rest <= 0.15);
    assert_eq!(pacing.next(seconds + rest + 1e-6, true), Draw::Scaled(1.0));
    pacing.drawn(0.1);
    assert!(pacing.is_settled());
}

#[test]
fn fast_pictures_stay_whole() {
    let mut pacing = Pacing::default();
    for frame in 0..30 {
        pacing.moved(f64::from(frame) * 0.01);
        assert_eq!(pacing.next(f64::from(frame) * 0.01, true), Draw::Scaled(1.0));
        pacing.drawn(0.005);
    }
}

#[test]
fn without_adaption_pictures_stay_whole() {
    let mut pacing = Pacing::default();
    for frame in 0..10 {
        pacing.moved(f64::from(frame));
        assert_eq!(pacing.next(f64::from(frame), false), Draw::Scaled(1.0));
        pacing.drawn(0.5);
    }
}

#[test]
fn lost_pictures_are_drawn_again() {
    let mut pacing = Pacing::default();
    pacing.changed();
    pacing.next(0.0, true);
    pacing.lost();
    assert_eq!(pacing.next(0.1, true), Draw::Scaled(1.0));
}

#[test]
fn messages_go_and_errors_stay() {
    let mut notices = Notices::default();
    notices.info("saved");
    notices.error("broken");
    notices.now = 1.0;
    assert_eq!(notices.shown().count(), 2);
    assert_eq!(notices.wake_in(), Some(3.0));
    notices.now = 60.0;
    assert_eq!(notices.shown().map(|n| n.text.as_str()).collect::<Vec<_>>(), ["broken"]);
    notices.dismiss(0);
    assert_eq!(notices.shown().count(), 0);
    assert_eq!(notices.log().collect::<Vec<_>>(), ["saved", "broken"]);
}

#[test]
fn repeated_messages_are_one() {
    let mut notices = Notices::default();
    for i in 0..50 {
        notices.now = f64::from(i);
        notices.warning("slow");
    }
    assert_eq!(notices.shown().count(), 1);
    assert_eq!(notices.log().count(), 1);
    (0..50).for_each(|i| notices.error(format!("{i}")));
    assert_eq!(notices.shown().count(), 4);
}

#[test]
fn results_arrive_and_wake() {
    let (waker, woken) = mpsc::channel();
    let job = Job::spawn("test", move || waker.send(()).unwrap(), || 6 * 7).unwrap();
    woken.recv().unwrap();
    assert!(matches!(job.poll(), JobState::Done(42)));
}

#[test]
fn a_job_that_panics_is_lost_and_wakes() {
    let (waker, woken) = mpsc::channel();
    let job: Job<u32> = Job::spawn("test", move || waker.send(()).unwrap(), || panic!("on purpose")).unwrap();
    woken.recv().unwrap();
    assert!(matches!(job.poll(), JobState::Lost));
}
