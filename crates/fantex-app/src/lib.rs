//! The viewer: opens models and assets, shows them through the GPU renderer, and shows how they are made and streamed.
//!
//! ```text
//!  main: arguments --> shell (window, GPU, dialogs) ----.------------------------.
//!                        | every frame                  v                        v
//!                        |             panels: functions that draw the      scene_view: pictures of the
//!                        v             state and edit it (egui)             scene, streaming, the atlas
//!                     Viewer  <--------------'                                   |
//!   camera, light, display, settings, document, session, pacing, figures  <------'
//! ```
//!
//! [`Viewer`](viewer::Viewer) is the whole state; it and everything below it know no window and are tested without one.
//! What only the shell can do (dialogs, pictures, ending) is asked of it as a [`Request`](viewer::Request).
//!
//! Others use [`shell::run`]; the other modules are open for the tests.

#[doc(hidden)]
pub mod camera;
#[doc(hidden)]
pub mod command;
#[doc(hidden)]
pub mod display;
#[doc(hidden)]
pub mod document;
#[doc(hidden)]
pub mod export;
#[doc(hidden)]
pub mod figures;
#[doc(hidden)]
pub mod job;
#[doc(hidden)]
pub mod light;
#[doc(hidden)]
pub mod live;
#[doc(hidden)]
pub mod notices;
#[doc(hidden)]
pub mod pacing;
#[doc(hidden)]
pub mod paint;
#[doc(hidden)]
pub mod panels;
#[doc(hidden)]
pub mod pen;
#[doc(hidden)]
pub mod readout;
#[doc(hidden)]
pub mod scene_view;
#[doc(hidden)]
pub mod session;
#[doc(hidden)]
pub mod settings;
pub mod shell;
#[doc(hidden)]
pub mod text;
#[doc(hidden)]
pub mod theme;
#[doc(hidden)]
pub mod viewer;
