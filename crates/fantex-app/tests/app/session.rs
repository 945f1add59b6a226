//! Sessions are read, and wait for what they asked for.

use fantex::base::Result;
use fantex_app::session::{Act, Session, SessionRunner, Situation, Step};

fn session(text: &str) -> Result<Session> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session.json");
    std::fs::write(&path, text).unwrap();
    Session::load(&path)
}

fn at(frame: u64) -> Situation {
    Situation { frame, seconds: frame as f64 / 10.0, ..Situation::default() }
}

#[test]
fn every_step_has_its_text() {
    let text = r#"{"steps":[{"wait_frames":3},{"wait_loaded":5},{"wait_sharp":2.5},{"key":"Ctrl+S"},
        {"hold":{"keys":["W"],"frames":9}},{"drag":{"x":0.1,"y":0,"with":["Ctrl"]}},
        {"camera":{"eye":[1,2,3],"target":[0,0,0]}},{"view":"three_quarter"},{"mode":"walk"},
        {"overlay":"blend_bands"},{"shading":"base_color"},{"tab":"light"},{"open":"a.glb"},
        {"surroundings":"sky"},{"pool":16},{"play":"way.json"},{"screenshot":{"path":"a.png","size":[64,32]}},
        {"window_screenshot":{"path":"b.png"}},{"resize":[0,0]},{"minimize":true},{"expect_message":"x"},
        {"preset":"Chalk"},{"brush":{"tip":"leaf"}},"quit"]}"#;
    let found = session(text).unwrap();
    assert_eq!(found.steps.len(), 24);
    let Step::Screenshot { path, .. } = &found.steps[16] else { panic!("{:?}", found.steps[16]) };
    assert!(path.is_absolute(), "paths are relative to the session: {}", path.display());
    let brush = session(r#"{"steps":[{"brush":{"stamp":"leaf.png"}}]}"#).unwrap();
    let Step::Brush(brush) = &brush.steps[0] else { panic!("{:?}", brush.steps[0]) };
    assert!(brush.stamp.as_ref().is_some_and(|path| path.is_absolute() && path.ends_with("leaf.png")));
}

#[test]
fn wrong_sessions_are_refused_in_a_sentence() {
    let message = |text| session(text).unwrap_err().to_string();
    assert!(message("{\"steps\":[{\"jump\":1}]}").contains("jump"));
    assert!(message("{\"steps\":[\"quit\",{\"key\":\"Hyper\"}]}").contains("session.json: step 2"));
    assert!(message("{").contains("no session"));
}

#[test]
fn steps_wait_for_what_they_asked_for() {
    let text = r#"{"steps":[{"wait_frames":2},{"screenshot":{"path":"a.png"}},{"wait_sharp":60},"quit"]}"#;
    let mut runner = SessionRunner::new(session(text).unwrap());
    assert_eq!(runner.next(&at(0)).unwrap(), Act::NextFrame);
    assert_eq!(runner.next(&at(1)).unwrap(), Act::NextFrame);
    assert!(matches!(runner.next(&at(2)).unwrap(), Act::Do(Step::Screenshot { .. })));
    assert_eq!(runner.next(&Situation { pictures_due: 1, ..at(3) }).unwrap(), Act::NextFrame);
    assert_eq!(runner.next(&at(4)).unwrap(), Act::NextFrame);
    assert_eq!(
        runner.next(&Situation { is_sharp: true, ..at(5) }).unwrap(),
        Act::NextFrame,
        "of the frame before"
    );
    assert_eq!(runner.next(&at(7)).unwrap(), Act::Wait, "no frame need be drawn for it");
    assert_eq!(runner.next(&Situation { is_sharp: true, ..at(8) }).unwrap(), Act::End);
}

#[test]
fn what_comes_after_a_drag_waits_for_its_end() {
    let mut runner = SessionRunner::new(session(r#"{"steps":[{"drag":{"x":0.1,"y":0}},"quit"]}"#).unwrap());
    assert!(matches!(runner.next(&at(0)).unwrap(), Act::Do(Step::Drag { .. })));
    assert_eq!(runner.next(&Situation { is_acting: true, ..at(9) }).unwrap(), Act::NextFrame);
    assert_eq!(runner.next(&at(10)).unwrap(), Act::End);
}

#[test]
fn waits_end() {
    let mut runner = SessionRunner::new(session(r#"{"steps":[{"wait_loaded":1}]}"#).unwrap());
    let opening = |frame| Situation { is_opening: true, ..at(frame) };
    assert_eq!(runner.next(&opening(0)).unwrap(), Act::NextFrame);
    assert_eq!(runner.next(&opening(10)).unwrap(), Act::Wait);
    let late = runner.next(&opening(11)).unwrap_err().to_string();
    assert!(late.contains("step 1") && late.contains("still being opened"), "{late}");
}

#[test]
fn missing_messages_end_a_session() {
    let mut runner = SessionRunner::new(session(r#"{"steps":[{"expect_message":"damaged"}]}"#).unwrap());
    let now = Situation { messages: vec!["all is well".into()], ..at(0) };
    assert!(runner.next(&now).unwrap_err().to_string().contains("all is well"));
}
