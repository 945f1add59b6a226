//! Signs of the tools, drawn with lines.

use eframe::egui::{Color32, CornerRadius, Painter, Pos2, Rect, Shape, Stroke, StrokeKind, Vec2, pos2, vec2};

use crate::paint::PaintTool;

/// Draws the sign of a tool into a square.
pub(super) fn tool(painter: &Painter, rect: Rect, tool: PaintTool, color: Color32) {
    let stroke = Stroke::new(1.7, color);
    // In a square of 20.
    let at = |x: f32, y: f32| rect.min + vec2(x, y) * (rect.width() / 20.0);
    match tool {
        PaintTool::Paint => {
            painter.line_segment([at(17.0, 2.5), at(9.5, 11.0)], Stroke::new(2.6, color));
            let tip = vec![at(8.2, 10.2), at(10.6, 12.4), at(8.4, 15.6), at(3.0, 17.4), at(5.0, 12.2)];
            painter.add(Shape::convex_polygon(tip, color, Stroke::NONE));
        }
        PaintTool::Erase => {
            let body = vec![at(7.5, 16.5), at(2.5, 11.5), at(11.0, 3.0), at(16.5, 8.5), at(8.5, 16.5)];
            painter.add(Shape::closed_line(body, stroke));
            painter.line_segment([at(6.6, 7.4), at(12.1, 12.9)], stroke);
            painter.line_segment([at(8.0, 17.3), at(17.5, 17.3)], stroke);
        }
        PaintTool::Fill => {
            let bucket = vec![at(3.0, 10.5), at(9.5, 4.0), at(16.0, 10.5), at(9.5, 17.0)];
            painter.add(Shape::closed_line(bucket, stroke));
            let paint = vec![at(3.6, 10.9), at(15.4, 10.9), at(9.5, 16.6)];
            painter.add(Shape::convex_polygon(paint, color, Stroke::NONE));
            painter.line_segment([at(9.5, 4.0), at(6.5, 1.5)], stroke);
            painter.circle_filled(at(17.6, 15.6), rect.width() * 0.07, color);
        }
        PaintTool::Blur => {
            for (radius, strength) in [(7.4, 0.22), (5.0, 0.45), (2.6, 1.0)] {
                let radius = radius * rect.width() / 20.0;
                painter.circle_filled(rect.center(), radius, color.gamma_multiply(strength));
            }
        }
        PaintTool::Smudge => {
            let finger = vec![at(12.0, 2.5), at(17.0, 7.0), at(12.5, 12.5), at(7.5, 8.0)];
            painter.add(Shape::closed_line(finger, stroke));
            for (x, strength) in [(9.0, 1.0), (6.2, 0.6), (3.4, 0.3)] {
                let radius = 2.3 * rect.width() / 20.0;
                painter.circle_filled(at(x, 14.5 + 0.35 * (9.0 - x)), radius, color.gamma_multiply(strength));
            }
        }
        PaintTool::Sticker => {
            let wide = Stroke::new(2.4, color);
            painter.line_segment([at(4.0, 4.0), at(16.0, 4.0)], wide);
            painter.line_segment([at(10.0, 4.0), at(10.0, 16.5)], wide);
            painter.line_segment([at(7.2, 16.5), at(12.8, 16.5)], Stroke::new(1.6, color));
        }
        PaintTool::Clone => {
            painter.circle_stroke(at(6.8, 12.6), 4.6 * rect.width() / 20.0, stroke);
            painter.circle_filled(at(13.0, 7.2), 4.9 * rect.width() / 20.0, color);
        }
        PaintTool::Pick => {
            painter.line_segment([at(3.0, 17.0), at(11.0, 9.0)], Stroke::new(2.4, color));
            painter.line_segment([at(9.0, 6.6), at(13.4, 11.0)], stroke);
            painter.line_segment([at(12.0, 8.0), at(16.0, 4.0)], Stroke::new(4.4, color));
        }
    }
}

/// An eye, open or closed.
pub(super) fn eye(painter: &Painter, rect: Rect, is_open: bool, color: Color32) {
    let c = rect.center();
    let half = vec2(7.0, if is_open { 4.2 } else { 2.6 });
    let arc = |up: f32| -> Vec<Pos2> {
        (0..=10)
            .map(|k| k as f32 / 10.0)
            .map(|t| {
                let bow = (t * std::f32::consts::PI).sin() * half.y * up;
                c + Vec2::new((2.0 * t - 1.0) * half.x, bow)
            })
            .collect()
    };
    let stroke = Stroke::new(1.3, color);
    painter.add(Shape::line(arc(1.0), stroke));
    if is_open {
        painter.add(Shape::line(arc(-1.0), stroke));
        painter.circle_filled(c, 2.1, color);
    }
}

/// A small square in a colour, framed so that it is seen on any ground.
pub(super) fn swatch(painter: &Painter, rect: Rect, [r, g, b]: [u8; 3], is_chosen: bool) {
    let radius = CornerRadius::same(3);
    painter.rect_filled(rect, radius, Color32::from_rgb(r, g, b));
    let frame = if is_chosen {
        Stroke::new(2.0, crate::theme::ACCENT)
    } else {
        Stroke::new(1.0, Color32::from_white_alpha(38))
    };
    painter.rect_stroke(rect, radius, frame, StrokeKind::Inside);
}

/// An arrow that points up or down.
pub(super) fn arrow(painter: &Painter, rect: Rect, is_up: bool, color: Color32) {
    let c = rect.center();
    let s = if is_up { -1.0 } else { 1.0 };
    let points =
        vec![pos2(c.x - 4.0, c.y - 2.0 * s), pos2(c.x, c.y + 2.5 * s), pos2(c.x + 4.0, c.y - 2.0 * s)];
    painter.add(Shape::line(points, Stroke::new(1.6, color)));
}
