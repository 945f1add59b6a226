//! The time axis: textures that follow each other.

use fantex_base::{Error, Result};
use glam::Vec4;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::combine::mix;
use crate::look::Slot;
use crate::{Allowed, Dependence, ShadingPoint, Texture};

/// What comes before the first and after the last frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FrameWrap {
    /// The first and the last frame, for ever.
    Hold,
    /// All frames again. The last one stays, or fades into the first, until the next round.
    #[default]
    Repeat,
    /// All frames backwards, then forwards again, the first and the last once each time.
    Mirror,
}

/// Textures with their times: a texture whose third (or fourth) dimension is the time.
#[derive(Clone, Debug)]
pub struct FrameTexture {
    /// Seconds, ascending; as many as textures.
    times: Vec<f32>,
    textures: Vec<Slot>,
    /// Seconds from the start of the first frame to the end of the last.
    duration: f32,
    wrap: FrameWrap,
    is_blended: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Moment {
    frame: usize,
    next: usize,
    share: f32,
}

impl FrameTexture {
    /// Frames that follow each other `rate` times a second from time 0 on. With `is_blended`, each fades into the next
    /// (colours count by their alpha); otherwise it stays until the next one starts.
    ///
    /// # Errors
    /// There is no frame, or the rate is not above 0.
    pub fn with_rate(textures: Vec<Slot>, rate: f32, wrap: FrameWrap, is_blended: bool) -> Result<Self> {
        Allowed::Positive.check("a texture over time", "the rate", &[rate])?;
        let duration = textures.len() as f32 / rate;
        let frames = textures.into_iter().enumerate().map(|(index, texture)| (index as f32 / rate, texture));
        Self::new(frames.collect(), duration, wrap, is_blended)
    }

    /// Frames with the seconds at which they start, in order. A round of [`FrameWrap::Repeat`] takes `duration` seconds.
    ///
    /// # Errors
    /// There is no frame, a time is not finite or not after the one before, or the duration is not positive or shorter
    /// than the frames take.
    pub fn new(frames: Vec<(f32, Slot)>, duration: f32, wrap: FrameWrap, is_blended: bool) -> Result<Self> {
        let (times, textures): (Vec<f32>, Vec<Slot>) = frames.into_iter().unzip();
        let (Some(&first), Some(&last)) = (times.first(), times.last()) else {
            return Err(Error::invalid("a texture over time needs at least one frame"));
        };
        Allowed::Finite.check("a texture over time", "the time of a frame", &times)?;
        Allowed::Positive.check("a texture over time", "the duration", &[duration])?;
        if let Some(index) = times.windows(2).position(|pair| pair[0] >= pair[1]) {
            let (later, time) = (index + 1, times[index + 1]);
            return Err(Error::invalid(format!(
                "frame {later} starts at {time} s, not after frame {index}; order the frames by time"
            )));
        }
        if duration < last - first {
            let last = last - first;
            return Err(Error::invalid(format!(
                "a round of {duration} s ends before the last frame, which starts {last} s after the first"
            )));
        }
        Ok(Self { times, textures, duration, wrap, is_blended })
    }

    /// What is shown at a time in seconds; one that is not finite counts as the start.
    fn moment(&self, time: f32) -> Moment {
        let last = self.times.len() - 1;
        let (start, end) = (self.times[0], self.times[last]);
        let since = if time.is_finite() { time - start } else { 0.0 };
        let since = match self.wrap {
            FrameWrap::Hold => since.clamp(0.0, end - start),
            FrameWrap::Repeat => since.rem_euclid(self.duration),
            FrameWrap::Mirror if last == 0 => 0.0,
            FrameWrap::Mirror => {
                let span = end - start;
                let back = since.rem_euclid(2.0 * span) - span;
                let since = span - back.abs();
                if back > 0.0 && !self.is_blended {
                    // On the way back, too, a frame stays until the next one, which is the one before.
                    let frame = self.times.partition_point(|&time| time - start < since).min(last);
                    return Moment { frame, next: frame, share: 0.0 };
                }
                since
            }
        };
        let frame = self.times.partition_point(|&time| time - start <= since).saturating_sub(1);
        let (next, next_start) = match self.times.get(frame + 1) {
            Some(&next_start) => (frame + 1, next_start - start),
            None if self.wrap == FrameWrap::Repeat => (0, self.duration),
            None => (frame, f32::INFINITY),
        };
        let frame_start = self.times[frame] - start;
        let share = ((since - frame_start) / (next_start - frame_start)).clamp(0.0, 1.0);
        // An empty stretch after the last frame gives NaN.
        let share = if self.is_blended && !share.is_nan() { share } else { 0.0 };
        Moment { frame, next, share }
    }
}

impl Texture for FrameTexture {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        let Moment { frame, next, share } = self.moment(at.time);
        let value = self.textures[frame].evaluate(at);
        if share == 0.0 || frame == next {
            return value;
        }
        mix(value, self.textures[next].evaluate(at), share)
    }

    fn depends_on(&self, what: Dependence) -> bool {
        let changes = what == Dependence::Time && self.textures.len() > 1;
        changes || self.textures.iter().any(|texture| texture.depends_on(what))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(wrap: FrameWrap, is_blended: bool) -> FrameTexture {
        let slots = [0.0, 1.0, 4.0].map(Slot::number);
        FrameTexture::new([1.0, 2.0, 4.0].into_iter().zip(slots).collect(), 5.0, wrap, is_blended).unwrap()
    }

    fn value(texture: &FrameTexture, time: f32) -> f32 {
        let Moment { frame, next, share } = texture.moment(time);
        let [a, b] = [frame, next].map(|index| match texture.textures[index] {
            Slot::Constant(value) => value.x,
            Slot::Texture(_) => f32::NAN,
        });
        a + (b - a) * share
    }

    #[test]
    fn frames_fade_into_each_other() {
        let texture = frames(FrameWrap::Hold, true);
        for (time, wanted) in
            [(-9.0, 0.0), (1.0, 0.0), (1.5, 0.5), (2.0, 1.0), (3.0, 2.5), (4.0, 4.0), (99.0, 4.0)]
        {
            assert_eq!(value(&texture, time), wanted, "at {time}");
        }
        let texture = frames(FrameWrap::Hold, false);
        for (time, wanted) in [(1.99, 0.0), (2.0, 1.0), (3.99, 1.0), (4.0, 4.0)] {
            assert_eq!(value(&texture, time), wanted, "at {time}");
        }
    }

    #[test]
    fn rounds_and_ways_back() {
        let texture = frames(FrameWrap::Repeat, true);
        // The last frame fades into the first from 4 s to 6 s.
        for (time, wanted) in [(4.0, 4.0), (5.0, 2.0), (6.0, 0.0), (6.5, 0.5), (0.0, 2.0), (1.5 + 50.0, 0.5)]
        {
            assert!((value(&texture, time) - wanted).abs() < 1e-4, "at {time}: {}", value(&texture, time));
        }
        let texture = frames(FrameWrap::Mirror, true);
        for (time, wanted) in [(4.0, 4.0), (5.0, 2.5), (6.0, 1.0), (7.0, 0.0), (8.0, 1.0), (0.0, 1.0)] {
            assert!((value(&texture, time) - wanted).abs() < 1e-4, "at {time}: {}", value(&texture, time));
        }
    }

    #[test]
    fn all_frames_stay_on_the_way_back() {
        let texture = frames(FrameWrap::Mirror, false);
        for (time, wanted) in
            [(1.5, 0.0), (3.0, 1.0), (4.0, 4.0), (4.5, 4.0), (6.0, 1.0), (6.5, 1.0), (7.0, 0.0), (0.5, 1.0)]
        {
            assert_eq!(value(&texture, time), wanted, "at {time}");
        }
    }

    #[test]
    fn odd_times_and_single_frames() {
        for wrap in [FrameWrap::Hold, FrameWrap::Repeat, FrameWrap::Mirror] {
            let single = FrameTexture::with_rate(vec![Slot::number(0.5)], 25.0, wrap, true).unwrap();
            for time in [0.0, -1.0, 1e9, f32::NAN, f32::INFINITY] {
                assert_eq!(value(&single, time), 0.5);
                assert!(value(&frames(wrap, true), time).is_finite());
            }
            assert!(!single.is_animated() && frames(wrap, true).is_animated());
        }
    }
}
