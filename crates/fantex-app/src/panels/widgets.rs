//! Small parts that several panels share.

use std::ops::RangeInclusive;
use std::path::Path;
use std::sync::Arc;

use eframe::egui::emath::Numeric;
use eframe::egui::{
    Align, Align2, Button, Color32, ColorImage, ComboBox, CornerRadius, DragValue, FontId, Grid, Id, Layout,
    Mesh, Pos2, Rect, Response, RichText, Sense, Shape, Slider, SliderClamping, Stroke, StrokeKind,
    TextureHandle, TextureOptions, Ui, Vec2, pos2, vec2,
};

use crate::document::Fact;
use crate::figures::History;
use crate::theme;

pub(super) fn heading(ui: &mut Ui, text: &str) {
    ui.add_space(6.0);
    ui.label(RichText::new(text).color(theme::STRONG).strong());
}

pub(super) fn hint(ui: &mut Ui, text: &str) {
    ui.label(RichText::new(text).small().color(theme::FAINT));
}

/// Names at the left, values at the right.
pub(super) fn facts<'a>(ui: &mut Ui, id: &str, facts: impl IntoIterator<Item = (&'a str, String)>) {
    Grid::new(id).num_columns(2).spacing([12.0, 4.0]).min_col_width(96.0).show(ui, |ui| {
        for (name, value) in facts {
            ui.label(RichText::new(name).color(theme::FAINT));
            ui.label(value);
            ui.end_row();
        }
    });
}

/// As [`facts`], of a document.
pub(super) fn document_facts(ui: &mut Ui, id: &str, all: &[Fact]) {
    facts(ui, id, all.iter().map(|fact| (fact.name, fact.value.clone())));
}

/// A row of an editor: its name at the left, the widget in a column of its own.
pub(super) fn row(ui: &mut Ui, name: &str, add: impl FnOnce(&mut Ui) -> Response) -> Response {
    ui.horizontal(|ui| {
        let label = name_label(ui, name);
        add(ui).labelled_by(label.id)
    })
    .inner
}

fn name_label(ui: &mut Ui, name: &str) -> Response {
    let size = vec2(96.0, ui.spacing().interact_size.y);
    let layout = Layout::left_to_right(Align::Center);
    ui.allocate_ui_with_layout(size, layout, |ui| {
        ui.set_min_width(size.x);
        ui.label(RichText::new(name).color(theme::FAINT))
    })
    .inner
}

/// A row with a number, to slide or to type.
pub(super) struct NumberRow<'a> {
    name: &'a str,
    suffix: &'a str,
    decimals: usize,
    tip: &'a str,
    is_logarithmic: bool,
}

pub(super) fn number<'a>(name: &'a str, suffix: &'a str, decimals: usize, tip: &'a str) -> NumberRow<'a> {
    NumberRow { name, suffix, decimals, tip, is_logarithmic: false }
}

impl NumberRow<'_> {
    pub(super) fn logarithmic(self) -> Self {
        Self { is_logarithmic: true, ..self }
    }

    /// Shows the row for a value that is edited within a range. One that lies beyond it stays as it is until then.
    pub(super) fn show<N: Numeric>(&self, ui: &mut Ui, value: &mut N, range: RangeInclusive<N>) {
        ui.horizontal(|ui| {
            let label = name_label(ui, self.name);
            let slider = Slider::new(value, range.clone())
                .show_value(false)
                .logarithmic(self.is_logarithmic)
                .clamping(SliderClamping::Edits);
            let response = ui.add(slider).labelled_by(label.id);
            if !self.tip.is_empty() {
                response.on_hover_text(self.tip);
            }
            let [low, high] = [range.start().to_f64(), range.end().to_f64()];
            let speed = if self.is_logarithmic { value.to_f64() * 0.02 } else { (high - low) / 400.0 };
            let number = DragValue::new(value)
                .range(range)
                .clamp_existing_to_range(false)
                .speed(speed)
                .suffix(self.suffix)
                .fixed_decimals(self.decimals);
            ui.add(number).labelled_by(label.id);
        });
    }
}

/// How many decimals show a hundredth of a length or of a range.
pub(super) fn decimals_of(length: f64) -> usize {
    (2 - length.max(1e-9).log10().floor() as i32).clamp(0, 9) as usize
}

/// Whether the hand still changes something: the pointer is down, or something is being typed.
pub(super) fn is_held(ui: &Ui) -> bool {
    ui.input(|i| i.pointer.any_down()) || ui.ctx().egui_wants_keyboard_input()
}

/// A button with a file's name that asks for another one.
pub(super) fn file_button(ui: &mut Ui, path: Option<&Path>, tip: &str) -> Response {
    let name = path.and_then(Path::file_name);
    let name = name.map_or("Choose …".into(), |name| name.to_string_lossy().into_owned());
    ui.add(Button::new(name).truncate()).on_hover_text(tip)
}

/// A texture that is made once for each value of a key, and remembered under an id.
pub(super) fn cached_texture<K: Clone + PartialEq + Send + Sync + 'static>(
    ui: &Ui,
    id: Id,
    key: K,
    make: impl FnOnce() -> ColorImage,
) -> TextureHandle {
    let known = ui.data(|data| data.get_temp::<(K, TextureHandle)>(id));
    if let Some((_, texture)) = known.filter(|(of, _)| *of == key) {
        return texture;
    }
    let texture = ui.ctx().load_texture("preview", make(), TextureOptions::LINEAR);
    ui.data_mut(|data| data.insert_temp(id, (key, texture.clone())));
    texture
}

/// A key that is equal to itself alone. It keeps what it stands for, so that nothing else gets the address.
pub(super) struct Itself<T: ?Sized>(pub(super) Arc<T>);

impl<T: ?Sized> Clone for Itself<T> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<T: ?Sized> PartialEq for Itself<T> {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

/// A texture in a frame.
pub(super) fn framed_picture(ui: &mut Ui, texture: &TextureHandle, size: Vec2) -> Response {
    let (rect, response) = ui.allocate_exact_size(size, Sense::hover());
    let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
    ui.painter().image(texture.id(), rect, whole, Color32::WHITE);
    let edge = Stroke::new(1.0, theme::LINE);
    ui.painter().rect_stroke(rect, CornerRadius::same(2), edge, StrokeKind::Inside);
    response
}

/// A choice among a few, as buttons side by side. Returns whether another was chosen.
pub(super) fn segments<T: Copy + PartialEq>(ui: &mut Ui, value: &mut T, all: &[(T, &str)]) -> bool {
    let before = *value;
    ui.spacing_mut().item_spacing.x = 2.0;
    for &(one, label) in all {
        ui.selectable_value(value, one, label);
    }
    *value != before
}

/// A choice among many, as a list that opens.
pub(super) fn choice<T: Copy + PartialEq>(
    ui: &mut Ui,
    id: &str,
    value: &mut T,
    all: &[(T, impl AsRef<str>)],
) -> Response {
    let chosen = all.iter().find(|(one, _)| one == value).map_or("", |(_, label)| label.as_ref());
    let list = ComboBox::from_id_salt(id).selected_text(chosen).show_ui(ui, |ui| {
        for (one, label) in all {
            ui.selectable_value(value, *one, label.as_ref());
        }
    });
    list.response
}

/// A name and a choice in a bar.
pub(super) fn named_choice<T: Copy + PartialEq>(
    ui: &mut Ui,
    name: &str,
    value: &mut T,
    all: &[(T, impl AsRef<str>)],
) {
    let name_id = ui.label(RichText::new(name).color(theme::FAINT)).id;
    choice(ui, name, value, all).labelled_by(name_id);
}

pub(super) fn dot(ui: &mut Ui, color: Color32) {
    let (rect, _) =
        ui.allocate_exact_size(vec2(10.0, ui.spacing().interact_size.y.min(18.0)), Sense::hover());
    ui.painter().circle_filled(rect.center(), 4.0, color);
}

/// A bar that is filled to a share (0..1).
pub(super) fn gauge(ui: &mut Ui, share: f32, color: Color32) -> Response {
    let (rect, response) = ui.allocate_exact_size(vec2(ui.available_width(), 6.0), Sense::hover());
    let radius = CornerRadius::same(3);
    ui.painter().rect_filled(rect, radius, theme::WELL);
    let filled = rect.with_max_x(rect.left() + rect.width() * share.clamp(0.0, 1.0));
    if filled.width() > 0.5 {
        ui.painter().rect_filled(filled, radius, color);
    }
    response
}

/// A graph of a history, the newest value at the right. `top` is the least upper end of its scale.
pub(super) struct Chart<'a> {
    pub(super) title: &'a str,
    pub(super) history: &'a History,
    pub(super) color: Color32,
    pub(super) top: f32,
    /// A line across, for a limit.
    pub(super) limit: Option<f32>,
    pub(super) text: &'a dyn Fn(f32) -> String,
}

impl Chart<'_> {
    /// Draws the graph with its title into a rectangle.
    pub(super) fn paint(&self, ui: &Ui, rect: Rect) {
        let painter = ui.painter_at(rect);
        painter.rect_filled(rect, CornerRadius::same(4), theme::WELL);
        let font = |size: f32| FontId::proportional(size);
        let inner = rect.shrink2(vec2(8.0, 6.0));
        painter.text(inner.left_top(), Align2::LEFT_TOP, self.title, font(11.0), theme::FAINT);
        let now = self.history.last().map_or("–".to_owned(), self.text);
        painter.text(inner.right_top(), Align2::RIGHT_TOP, now, font(12.0), theme::STRONG);
        let plot = Rect::from_min_max(inner.left_top() + vec2(0.0, 20.0), inner.right_bottom());
        let top = self.scale();
        painter.hline(plot.x_range(), plot.bottom(), Stroke::new(1.0, theme::LINE));
        painter.hline(plot.x_range(), plot.top(), Stroke::new(1.0, theme::LINE.gamma_multiply(0.6)));
        painter.text(
            plot.left_top() + vec2(0.0, 1.0),
            Align2::LEFT_TOP,
            (self.text)(top),
            font(9.5),
            theme::FAINT,
        );
        if let Some(limit) = self.limit.filter(|&limit| limit < top) {
            let y = plot.bottom() - plot.height() * limit / top;
            painter.add(Shape::dashed_line(
                &[pos2(plot.left(), y), pos2(plot.right(), y)],
                Stroke::new(1.0, theme::FAINT.gamma_multiply(0.5)),
                3.0,
                3.0,
            ));
        }
        let points = self.points(plot, top);
        if points.len() >= 2 {
            painter.add(filled_below(&points, plot.bottom(), self.color.gamma_multiply(0.16)));
            painter.add(Shape::line(points, Stroke::new(1.4, self.color)));
        }
    }

    /// The upper end of the scale: one of 1, 2, 5 times a power of ten.
    fn scale(&self) -> f32 {
        // A few outliers, such as the first frame, may leave the graph.
        let most = self.history.percentile(0.97).unwrap_or(0.0).max(self.top);
        if most <= self.top {
            return self.top;
        }
        let power = 10f32.powf(most.log10().floor());
        [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|&end| end >= most).unwrap_or(most)
    }

    fn points(&self, plot: Rect, top: f32) -> Vec<Pos2> {
        let step = plot.width() / (self.history.capacity() - 1).max(1) as f32;
        let count = self.history.iter().len();
        let at = |(i, value): (usize, f32)| {
            let x = plot.right() - (count - 1 - i) as f32 * step;
            pos2(x, plot.bottom() - plot.height() * (value / top).clamp(0.0, 1.0))
        };
        self.history.iter().enumerate().map(at).collect()
    }
}

/// The area between a line and the bottom of a graph, without seams.
fn filled_below(points: &[Pos2], bottom: f32, color: Color32) -> Shape {
    let mut mesh = Mesh::default();
    for &point in points {
        mesh.colored_vertex(point, color);
        mesh.colored_vertex(pos2(point.x, bottom), color);
    }
    for i in 1..points.len() as u32 {
        let [a, b, c, d] = [2 * i - 2, 2 * i - 1, 2 * i, 2 * i + 1];
        mesh.add_triangle(a, b, c);
        mesh.add_triangle(b, d, c);
    }
    Shape::mesh(mesh)
}

/// A button of a bar that is pressed while something is on.
pub(super) fn switch(ui: &mut Ui, is_on: bool, text: &str, tip: &str) -> bool {
    ui.add(Button::selectable(is_on, text)).on_hover_text(tip).clicked()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimals_follow_the_size() {
        assert_eq!(
            [2000.0, 30.0, 1.0, 0.02, 3e-6, 0.0, f64::INFINITY].map(decimals_of),
            [0, 1, 2, 4, 8, 9, 0]
        );
    }
}
