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

pub mod camera;
pub mod command;
pub mod display;
pub mod document;
pub mod figures;
pub mod job;
pub mod light;
pub mod notices;
pub mod pacing;
pub mod paint;
pub mod panels;
pub mod scene_view;
pub mod session;
pub mod settings;
pub mod shell;
pub mod theme;
pub mod viewer;
