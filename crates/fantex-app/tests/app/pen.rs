//! Pressure of tablets: readings beside the window's events, and what the X server tells.

use fantex_app::pen::{PenReadings, felt};

#[test]
fn readings_are_spread_over_moves() {
    let readings = PenReadings::default();
    assert_eq!(readings.take(3), [None; 3]);
    let put = |values: &[f32]| values.iter().for_each(|&value| readings.put(Some(value)));
    put(&[0.1, 0.2, 0.3]);
    assert_eq!(readings.waiting(), 3);
    assert_eq!(readings.take(3), [0.1, 0.2, 0.3].map(Some));
    // Fewer moves skip readings, more of them wait with the one before; the last move always has the last reading.
    put(&[0.4, 0.5, 0.6, 0.7]);
    assert_eq!(readings.take(2), [0.5, 0.7].map(Some));
    put(&[0.8, 0.9]);
    assert_eq!(readings.take(4), [0.7, 0.8, 0.8, 0.9].map(Some));
    assert_eq!(readings.take(2), [0.9; 2].map(Some), "nothing new");
    put(&[0.2]);
    assert_eq!((readings.take(0), readings.take(1)), (vec![], vec![Some(0.2)]));
    readings.put(None);
    assert_eq!(readings.take(1), [None], "a mouse");
}

#[test]
fn no_more_readings_are_kept_than_a_frame_needs() {
    let readings = PenReadings::default();
    (0..5000).for_each(|i| readings.put(Some(i as f32 / 5000.0)));
    assert!(readings.waiting() <= 1024);
    assert_eq!(readings.take(1), [Some(4999.0 / 5000.0)]);
}

#[test]
fn soft_pens_need_less_force() {
    for pressure in [0.0, 0.3, 1.0] {
        assert_eq!(felt(pressure, 0.0), pressure);
    }
    assert!((felt(0.25, 1.0) - 0.5).abs() < 1e-6 && (felt(0.5, -1.0) - 0.25).abs() < 1e-6);
    for softness in [-1.0, -0.4, 0.7, 1.0] {
        assert_eq!((felt(0.0, softness), felt(1.0, softness), felt(1.5, softness)), (0.0, 1.0, 1.0));
        assert!((0..100).all(|i| felt(i as f32 / 100.0, softness) < felt((i + 1) as f32 / 100.0, softness)));
    }
}

#[cfg(target_os = "linux")]
mod x11 {
    use fantex_app::pen::x11::{Axis, axis, pressure_of};
    use x11rb::protocol::xinput::{
        DeviceClassData, DeviceClassDataValuator, Fp3232, PointerEventFlags, RawMotionEvent, ValuatorMode,
    };

    const LABEL: u32 = 77;

    fn fixed(value: f64) -> Fp3232 {
        let integral = value.floor();
        Fp3232 { integral: integral as i32, frac: ((value - integral) * 4_294_967_296.0) as u32 }
    }

    /// Values of some axes.
    fn event(values: &[(usize, f64)]) -> RawMotionEvent {
        let mut valuator_mask = vec![0; 2];
        values.iter().for_each(|&(number, _)| valuator_mask[number / 32] |= 1 << (number % 32));
        let axisvalues_raw: Vec<Fp3232> = values.iter().map(|&(_, value)| fixed(value)).collect();
        RawMotionEvent {
            response_type: 35,
            extension: 131,
            sequence: 0,
            length: 0,
            event_type: 17,
            deviceid: 2,
            time: 0,
            detail: 0,
            sourceid: 11,
            flags: PointerEventFlags::default(),
            valuator_mask,
            axisvalues: axisvalues_raw.clone(),
            axisvalues_raw,
        }
    }

    #[test]
    fn pressure_is_found_among_the_axes_that_moved() {
        // As a tablet of 2048 steps: x, y, pressure, tilt.
        let axis = Axis { number: 2, range: [0.0, 2047.0] };
        let of = |values: &[_]| pressure_of(&axis, &event(values));
        assert_eq!(of(&[(0, 100.0), (1, 200.5), (2, 2047.0), (3, -3.0)]), Some(1.0));
        assert_eq!(of(&[(1, 200.5), (2, 2047.0 / 4.0), (3, 12.0)]), Some(0.25));
        assert_eq!(of(&[(2, 0.0)]), Some(0.0));
        assert_eq!(of(&[(2, 9000.0)]), Some(1.0), "beyond its range");
        assert_eq!(of(&[(0, 100.0), (1, 200.5)]), None, "pressure has not moved");
        let far = Axis { number: 40, range: [-1.0, 1.0] };
        assert_eq!(pressure_of(&far, &event(&[(0, 5.0), (31, 7.0), (33, 8.0), (40, 0.5)])), Some(0.75));
        // What does not hold together is no reading.
        let mut short = event(&[(0, 1.0), (2, 2.0)]);
        short.axisvalues_raw.truncate(1);
        assert_eq!(pressure_of(&axis, &short), None);
        short.valuator_mask.clear();
        assert_eq!(pressure_of(&axis, &short), None);
    }

    #[test]
    fn the_axis_is_known_by_its_name_and_range() {
        let valuator = |label, min, max| {
            DeviceClassData::Valuator(DeviceClassDataValuator {
                number: 2,
                label,
                min: fixed(min),
                max: fixed(max),
                value: fixed(0.0),
                resolution: 1,
                mode: ValuatorMode::ABSOLUTE,
            })
        };
        let expected = Axis { number: 2, range: [0.0, 65536.0] };
        assert_eq!(axis(&valuator(LABEL, 0.0, 65536.0), LABEL), Some(expected));
        assert_eq!(axis(&valuator(LABEL + 1, 0.0, 65536.0), LABEL), None);
        assert_eq!(axis(&valuator(LABEL, -1.0, -1.0), LABEL), None, "no range");
    }
}
