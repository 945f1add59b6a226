//! Pressure by the X Input Extension ("The X Input Extension 2.2", 2012): raw events, which go to every client that selects them, whoever has
//! grabbed the pointer.

use std::collections::BTreeMap;
use std::error::Error;

use x11rb::connection::Connection;
use x11rb::protocol::Event;
use x11rb::protocol::xinput::{
    ConnectionExt as _, DeviceClass, DeviceClassData, EventMask, Fp3232, RawMotionEvent, XIEventMask,
};
use x11rb::protocol::xproto::{Atom, ConnectionExt as _};
use x11rb::rust_connection::RustConnection;

use super::PenReadings;

/// What the drivers of tablets (libinput, wacom, evdev) call the axis.
const PRESSURE: &[u8] = b"Abs Pressure";

const ALL_DEVICES: u16 = 0;
const ALL_MASTERS: u16 = 1;

/// An axis of a device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    pub number: u16,
    /// The ends of its range; the second is above the first.
    pub range: [f64; 2],
}

/// By device.
type Axes = BTreeMap<u16, Axis>;

/// Begins to listen on the display that `DISPLAY` (or `display`) names, on a thread that lives as long as the display.
///
/// # Errors
/// There is no such display, or it has no X Input Extension 2.
pub fn listen(display: Option<&str>, readings: PenReadings) -> Result<(), Box<dyn Error>> {
    let (connection, screen) = x11rb::connect(display)?;
    connection.xinput_xi_query_version(2, 2)?.reply()?;
    let label = connection.intern_atom(false, PRESSURE)?.reply()?.atom;
    let root = connection.setup().roots[screen].root;
    let masks = [
        EventMask {
            deviceid: ALL_MASTERS,
            mask: vec![XIEventMask::RAW_MOTION | XIEventMask::RAW_BUTTON_PRESS],
        },
        EventMask { deviceid: ALL_DEVICES, mask: vec![XIEventMask::HIERARCHY] },
    ];
    connection.xinput_xi_select_events(root, &masks)?.check()?;
    let axes = axes(&connection, label)?;
    std::thread::Builder::new()
        .name("pen".into())
        .spawn(move || follow(&connection, label, axes, &readings))?;
    Ok(())
}

/// Until the display is closed.
fn follow(connection: &RustConnection, label: Atom, mut axes_of_devices: Axes, readings: &PenReadings) {
    let mut last = BTreeMap::new();
    while let Ok(event) = connection.wait_for_event() {
        match event {
            Event::XinputHierarchy(_) => match axes(connection, label) {
                Ok(found) => axes_of_devices = found,
                Err(_) => return,
            },
            Event::XinputRawMotion(event) | Event::XinputRawButtonPress(event) => {
                let pressure = axes_of_devices.get(&event.sourceid).map(|axis| {
                    // An axis that has not moved is left out.
                    let last = last.entry(event.sourceid).or_insert(0.0);
                    *last = pressure_of(axis, &event).unwrap_or(*last);
                    *last
                });
                readings.put(pressure);
            }
            _ => {}
        }
    }
}

/// The devices with an axis of that name.
fn axes(connection: &RustConnection, label: Atom) -> Result<Axes, Box<dyn Error>> {
    let devices = connection.xinput_xi_query_device(ALL_DEVICES)?.reply()?.infos;
    let axis_of = |classes: &[_]| classes.iter().find_map(|class: &DeviceClass| axis(&class.data, label));
    let found = devices.iter().filter_map(|device| Some((device.deviceid, axis_of(&device.classes)?)));
    Ok(found.collect())
}

/// The axis that a class of a device describes, if it has that name and a range.
pub fn axis(class: &DeviceClassData, label: Atom) -> Option<Axis> {
    let DeviceClassData::Valuator(valuator) = class else { return None };
    let range = [valuator.min, valuator.max].map(number);
    (valuator.label == label && range[1] > range[0]).then_some(Axis { number: valuator.number, range })
}

/// The value of an axis in an event, 0..1 of its range, if it has changed.
pub fn pressure_of(axis: &Axis, event: &RawMotionEvent) -> Option<f32> {
    let has = |number: usize| {
        event.valuator_mask.get(number / 32).is_some_and(|bits| bits >> (number % 32) & 1 == 1)
    };
    let own = usize::from(axis.number);
    if !has(own) {
        return None;
    }
    // Values of the axes that have changed, in their order.
    let place = (0..own).filter(|&number| has(number)).count();
    let value = number(*event.axisvalues_raw.get(place)?);
    let [low, high] = axis.range;
    Some(((value - low) / (high - low)).clamp(0.0, 1.0) as f32)
}

/// Fixed point with 32 bits behind it.
fn number(value: Fp3232) -> f64 {
    f64::from(value.integral) + f64::from(value.frac) / 4_294_967_296.0
}
