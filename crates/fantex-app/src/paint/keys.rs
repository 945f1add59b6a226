//! Keys of the painter, as painters know them. While something is painted they come before those of the viewer.

use eframe::egui::{Key, Modifiers};

use super::PaintTool;
use crate::command::{Command, Section, Shortcut};

/// Something that a key or a button does.
#[derive(Clone, Debug, PartialEq)]
pub enum PaintCommand {
    /// Another tool.
    Tool(PaintTool),
    /// Larger or smaller, in steps.
    Size(i32),
    /// Harder or softer, in tenths.
    Hardness(i32),
    /// Opacity in per cent.
    Opacity(u32),
    /// Flow in per cent.
    Flow(u32),
    /// Foreground and background change places.
    SwapColors,
    /// Black and white.
    ResetColors,
    /// One step back.
    Undo,
    /// One step forth.
    Redo,
    /// Mirror on or off.
    ToggleSymmetry,
    /// The picture over the view on or off.
    ToggleStencil,
    /// The pointer moves the picture over the view, or paints.
    AdjustStencil,
    /// The picture over the view goes onto all that is seen.
    Project,
    /// A layer above the chosen one.
    AddLayer,
    /// Save now.
    Save,
    /// Brush and layer panels on or off.
    TogglePanels,
}

impl PaintCommand {
    /// Whether it is done again while its key is held.
    pub fn repeats(&self) -> bool {
        matches!(self, Self::Size(_) | Self::Hardness(_) | Self::Undo | Self::Redo)
    }
}

/// All keys of the painter.
pub fn paint_shortcuts() -> Vec<Shortcut> {
    use PaintCommand::{
        AddLayer, AdjustStencil, Flow, Hardness, Opacity, Project, Redo, ResetColors, Save, Size, SwapColors,
        TogglePanels, ToggleStencil, ToggleSymmetry, Tool, Undo,
    };
    const NONE: Modifiers = Modifiers::NONE;
    const SHIFT: Modifiers = Modifiers::SHIFT;
    const CONTROL: Modifiers = Modifiers::COMMAND;
    let row = |modifiers, key, command, text| Shortcut {
        command: Command::Paint(command),
        modifiers,
        key,
        text,
        section: Section::Painting,
    };
    let mut rows = vec![
        row(NONE, Key::B, Tool(PaintTool::Paint), "Paint"),
        row(NONE, Key::E, Tool(PaintTool::Erase), "Erase"),
        row(NONE, Key::G, Tool(PaintTool::Fill), "Fill"),
        row(NONE, Key::U, Tool(PaintTool::Blur), "Blur"),
        row(NONE, Key::K, Tool(PaintTool::Smudge), "Smudge"),
        row(NONE, Key::C, Tool(PaintTool::Clone), "Clone"),
        row(NONE, Key::T, Tool(PaintTool::Sticker), "Text and pictures"),
        row(NONE, Key::I, Tool(PaintTool::Pick), "Pick a colour (also Alt + click)"),
        row(NONE, Key::OpenBracket, Size(-1), "Smaller brush"),
        row(NONE, Key::CloseBracket, Size(1), "Larger brush"),
        row(SHIFT, Key::OpenBracket, Hardness(-1), "Softer brush"),
        row(SHIFT, Key::CloseBracket, Hardness(1), "Harder brush"),
        row(NONE, Key::X, SwapColors, "Swap colours"),
        row(NONE, Key::D, ResetColors, "Black and white"),
        row(NONE, Key::S, ToggleSymmetry, "Symmetry"),
        row(NONE, Key::N, ToggleStencil, "Picture over the view"),
        row(SHIFT, Key::N, AdjustStencil, "Move that picture"),
        row(CONTROL, Key::J, Project, "Project it onto what is seen"),
        row(CONTROL, Key::Z, Undo, "Undo"),
        row(CONTROL | SHIFT, Key::Z, Redo, "Redo"),
        row(CONTROL | SHIFT, Key::N, AddLayer, "New layer"),
        row(CONTROL, Key::S, Save, "Save now (it saves by itself, too)"),
        row(NONE, Key::Tab, TogglePanels, "Hide or show the panels"),
    ];
    let digits = [
        Key::Num1,
        Key::Num2,
        Key::Num3,
        Key::Num4,
        Key::Num5,
        Key::Num6,
        Key::Num7,
        Key::Num8,
        Key::Num9,
        Key::Num0,
    ];
    for (key, tenths) in digits.into_iter().zip(1..) {
        rows.push(row(NONE, key, Opacity(10 * tenths), "Opacity"));
        rows.push(row(SHIFT, key, Flow(10 * tenths), "Flow"));
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::command::{command_while, parse_keys};

    #[test]
    fn no_key_of_the_painter_has_two_meanings() {
        let all = paint_shortcuts();
        for (i, a) in all.iter().enumerate() {
            assert!(all[..i].iter().all(|b| !(a.key == b.key && a.modifiers == b.modifiers)), "{}", a.text);
            let (modifiers, key) = parse_keys(&a.keys().replace(' ', "")).unwrap();
            assert_eq!(command_while(true, modifiers, key).as_ref(), Some(&a.command));
        }
    }

    #[test]
    fn the_viewer_s_keys_stay_where_painting_needs_none() {
        let help = command_while(true, Modifiers::NONE, Key::F1);
        assert_eq!(help, Some(Command::ToggleHelp));
        assert_eq!(command_while(false, Modifiers::NONE, Key::X), Some(Command::ToggleShadows));
    }
}
