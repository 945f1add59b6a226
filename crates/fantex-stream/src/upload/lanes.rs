//! Pieces of an upload that are put there several at a time.

use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::refusal::Refusal;
use super::sent_file::Upload;

/// Pieces of one kind.
pub(super) struct Lane {
    /// Which ones, in the order in which they begin.
    pub(super) numbers: Vec<usize>,
    /// Most that are under way at once.
    pub(super) at_once: usize,
}

/// Puts `count` pieces there by their numbers; gives their tags, in order. The first one that fails ends the upload.
pub(super) fn put_in_lanes<E: From<Refusal> + Send>(
    upload: &Upload<'_>,
    count: usize,
    lanes: &[Lane],
    put: &(dyn Fn(usize) -> Result<String, E> + Sync),
) -> Result<Vec<String>, E> {
    let nexts: Vec<AtomicUsize> = lanes.iter().map(|_| AtomicUsize::new(0)).collect();
    let tags = Mutex::new(vec![String::new(); count]);
    let failure: Mutex<Option<E>> = Mutex::new(None);
    let work = |lane: usize| {
        while !upload.stops.load(Relaxed) {
            let Some(&number) = lanes[lane].numbers.get(nexts[lane].fetch_add(1, Relaxed)) else { return };
            match put(number) {
                Ok(tag) => locked(&tags)[number] = tag,
                Err(why) => {
                    locked(&failure).get_or_insert(why);
                    upload.stops.store(true, Relaxed);
                }
            }
        }
    };
    let work = &work;
    std::thread::scope(|scope| {
        let start = |lane: usize| {
            let builder = std::thread::Builder::new().name("fan-upload".into());
            builder.spawn_scoped(scope, move || work(lane)).is_ok()
        };
        let is_started = |&lane: &usize| {
            let Lane { numbers, at_once } = &lanes[lane];
            (0..numbers.len().min(*at_once)).filter(|_| start(lane)).count() > 0
        };
        let (_, left): (Vec<usize>, Vec<usize>) = (0..lanes.len()).partition(is_started);
        // Where the system refuses threads, this one does their work.
        left.into_iter().for_each(work);
    });
    match failure.into_inner().unwrap_or_else(PoisonError::into_inner) {
        Some(failure) => Err(failure),
        None if upload.is_ended() => Err(Refusal::cancelled().into()),
        None => Ok(tags.into_inner().unwrap_or_else(PoisonError::into_inner)),
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;
    use std::path::Path;
    use std::sync::atomic::{AtomicBool, AtomicU64};
    use std::time::Duration;

    use super::super::refusal::refusal_of;
    use super::*;

    fn go_on(_: u64, _: u64) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn upload() -> Upload<'static> {
        let (sent, stops, has_parts) = (AtomicU64::new(0), AtomicBool::new(false), AtomicBool::new(false));
        Upload { path: Path::new("a.fan"), length: 0, modified: None, sent, stops, has_parts, watch: &go_on }
    }

    #[test]
    fn each_lane_has_as_many_under_way_as_it_may() {
        let even = Lane { numbers: (0..60).step_by(2).collect(), at_once: 5 };
        let odd = Lane { numbers: (0..60).skip(1).step_by(2).collect(), at_once: 2 };
        let (now, most) = ([0, 0].map(AtomicUsize::new), [0, 0].map(AtomicUsize::new));
        let put = |number: usize| -> Result<String, Refusal> {
            let lane = number % 2;
            most[lane].fetch_max(now[lane].fetch_add(1, Relaxed) + 1, Relaxed);
            std::thread::sleep(Duration::from_millis(2));
            now[lane].fetch_sub(1, Relaxed);
            Ok(number.to_string())
        };
        let tags = put_in_lanes(&upload(), 60, &[even, odd], &put).unwrap();
        assert_eq!(tags, (0..60).map(|number| number.to_string()).collect::<Vec<_>>());
        let most = most.map(AtomicUsize::into_inner);
        assert!((2..=5).contains(&most[0]) && (1..=2).contains(&most[1]), "{most:?}");
    }

    #[test]
    fn what_fails_first_ends_all_and_is_told() {
        let begun = AtomicUsize::new(0);
        let put = |number: usize| -> Result<String, Refusal> {
            begun.fetch_add(1, Relaxed);
            if number == 2 { Err(refusal_of(403, Some("AccessDenied"))) } else { Ok(String::new()) }
        };
        let upload = upload();
        let lane = Lane { numbers: (0..1000).collect(), at_once: 1 };
        let refusal = put_in_lanes(&upload, 1000, &[lane], &put).unwrap_err();
        assert_eq!((refusal.status, begun.into_inner()), (403, 3));
    }
}
