//! The theme tokens: all colours and distances of the window, named by their meaning, for both themes.
//!
//! Only colours that carry a meaning are saturated. Text has a contrast of at least 4.5 to its background (checked by a
//! test).

use egui::{
    Color32, Context, CornerRadius, FontFamily, FontId, Margin, Shadow, Stroke, TextStyle, Theme, Ui, Vec2,
};
use std::num::NonZeroUsize;

/// Grid of all distances, in points: they are multiples of it.
pub const UNIT: f32 = 4.0;

/// Colours by meaning.
#[derive(Clone, Debug, PartialEq)]
pub struct Tokens {
    /// Whether this is the dark theme.
    pub dark: bool,
    /// Background colours from the deepest (canvas of a map or an image) to the highest: canvas, panel, control, popup.
    pub surface: [Color32; 4],
    /// Thin lines between areas.
    pub line: Color32,
    /// Text.
    pub text: Color32,
    /// Secondary text, such as explanations and names.
    pub weak: Color32,
    /// Emphasized text and marks: titles, the value under the pointer.
    pub strong: Color32,
    /// Selected and clickable elements.
    pub accent: Color32,
    /// Background of selected elements.
    pub selected: Color32,
    /// Normal state.
    pub ok: Color32,
    /// Warning.
    pub warning: Color32,
    /// Error.
    pub error: Color32,
    /// Background of the emergency stop; text on it is [`Tokens::on_stop`].
    pub stop: Color32,
    /// Text on [`Tokens::stop`].
    pub on_stop: Color32,
    /// Text on [`Tokens::warning`].
    pub on_warning: Color32,
    /// Unknown values.
    pub unknown: Color32,
    /// Outdated values.
    pub stale: Color32,
    /// Colours of tracks and curves, distinguishable by colour-blind people: eight in the order of Okabe and Ito,
    /// adapted to the background, and four that differ from these.
    pub series: [Color32; 12],
}

const fn rgb(hex: u32) -> Color32 {
    Color32::from_rgb((hex >> 16) as u8, (hex >> 8) as u8, hex as u8)
}

const DARK: Tokens = Tokens {
    dark: true,
    surface: [rgb(0x0c_0f11), rgb(0x14_181b), rgb(0x1f_2529), rgb(0x1a_1f23)],
    line: rgb(0x2b_3338),
    text: rgb(0xca_d3d8),
    weak: rgb(0x8a_979e),
    strong: rgb(0xf4_f7f8),
    accent: rgb(0x5a_a9ff),
    selected: rgb(0x17_2e4a),
    ok: rgb(0x4c_c38a),
    warning: rgb(0xf2_b23e),
    error: rgb(0xff_6b63),
    stop: rgb(0xc4_2b24),
    on_stop: rgb(0xff_ffff),
    on_warning: rgb(0x0c_0f11),
    unknown: rgb(0x6b_777d),
    stale: rgb(0x9d_8f7a),
    series: [
        rgb(0x56_b4e9),
        rgb(0xe6_9f00),
        rgb(0x2f_c79a),
        rgb(0xe4_87bd),
        rgb(0xf0_e442),
        rgb(0xf0_7b4a),
        rgb(0x7f_a3ff),
        rgb(0xb8_c4ca),
        rgb(0xa4_5cf0),
        rgb(0xd1_3b7f),
        rgb(0xa9_622e),
        rgb(0x5a_6fb0),
    ],
};

const LIGHT: Tokens = Tokens {
    dark: false,
    surface: [rgb(0xea_eef0), rgb(0xf9_fafa), rgb(0xe3_e8ea), rgb(0xff_ffff)],
    line: rgb(0xcb_d3d7),
    text: rgb(0x2a_3338),
    weak: rgb(0x5b_686f),
    strong: rgb(0x0a_0d0f),
    accent: rgb(0x0b_63c5),
    selected: rgb(0xd6_e7fb),
    ok: rgb(0x10_754a),
    warning: rgb(0x92_5b00),
    error: rgb(0xc4_2b24),
    stop: rgb(0xc4_2b24),
    on_stop: rgb(0xff_ffff),
    on_warning: rgb(0xff_ffff),
    unknown: rgb(0x7c_888e),
    stale: rgb(0x7a_6a50),
    series: [
        rgb(0x00_72b2),
        rgb(0xa5_6300),
        rgb(0x00_8a66),
        rgb(0xb3_4d87),
        rgb(0x6f_7d00),
        rgb(0xcc_4a10),
        rgb(0x4b_5fd0),
        rgb(0x4c_585e),
        rgb(0x6a_1fb0),
        rgb(0x5e_1430),
        rgb(0x3d_4a00),
        rgb(0x1f_3a7a),
    ],
};

/// The tokens of the theme of `ui`.
pub fn tokens(ui: &Ui) -> &'static Tokens {
    tokens_of(if ui.visuals().dark_mode { Theme::Dark } else { Theme::Light })
}

/// The tokens of a theme.
pub fn tokens_of(theme: Theme) -> &'static Tokens {
    match theme {
        Theme::Dark => &DARK,
        Theme::Light => &LIGHT,
    }
}

/// Contrast ratio of two colours by WCAG 2, 1 to 21.
pub fn contrast(a: Color32, b: Color32) -> f32 {
    let luminance = |color: Color32| {
        let [r, g, b, _] = egui::Rgba::from(color).to_array();
        0.2126 * r + 0.7152 * g + 0.0722 * b
    };
    let (a, b) = (luminance(a) + 0.05, luminance(b) + 0.05);
    if a > b { a / b } else { b / a }
}

/// Least contrast of a text whose colour comes from a message.
const LEAST_CONTRAST: f32 = 2.5;

impl Tokens {
    /// The colour of a text on a label, given that of a message: the theme's own, if that could not be read there.
    pub fn legible(&self, color: Color32) -> Color32 {
        let is_legible = contrast(color.to_opaque(), self.surface[3]) >= LEAST_CONTRAST;
        if is_legible { color } else { self.text }
    }

    /// Colour of series `index`; colours repeat after the last.
    pub fn series(&self, index: usize) -> Color32 {
        self.series[index % self.series.len()]
    }

    /// Background of maps and images.
    pub fn canvas(&self) -> Color32 {
        self.surface[0]
    }

    /// Background of panels.
    pub fn panel(&self) -> Color32 {
        self.surface[1]
    }
}

/// How often a frame is laid out at most. A bar takes three passes where an item changes its width: one finds it, one measures
/// the forms of the item, one has nothing to measure. Where that takes several frames, egui draws a warning over them.
const MOST_PASSES: NonZeroUsize = NonZeroUsize::MIN.saturating_add(3);

/// Installs the icons and both themes in a context. Call it once, before the first pass.
pub fn install(ctx: &Context) {
    ctx.options_mut(|options| options.max_passes = MOST_PASSES);
    egui_material_icons::initialize(ctx);
    for theme in [Theme::Dark, Theme::Light] {
        ctx.style_mut_of(theme, |style| apply(style, tokens_of(theme)));
    }
}

fn apply(style: &mut egui::Style, tokens: &Tokens) {
    style.text_styles = [
        (TextStyle::Small, FontId::new(11.0, FontFamily::Proportional)),
        (TextStyle::Body, FontId::new(13.0, FontFamily::Proportional)),
        (TextStyle::Button, FontId::new(13.0, FontFamily::Proportional)),
        (TextStyle::Heading, FontId::new(16.0, FontFamily::Proportional)),
        (TextStyle::Monospace, FontId::new(12.0, FontFamily::Monospace)),
    ]
    .into();
    style.animation_time = 0.0; // No animations: motion on the screen is reserved for data.
    let spacing = &mut style.spacing;
    spacing.item_spacing = Vec2::new(2.0 * UNIT, UNIT);
    spacing.button_padding = Vec2::new(2.0 * UNIT, 2.0);
    spacing.interact_size = Vec2::new(8.0 * UNIT, 5.0 * UNIT);
    spacing.indent = 4.0 * UNIT;
    spacing.window_margin = Margin::same(8);
    spacing.menu_margin = Margin::same(4);
    spacing.icon_width = 14.0;
    spacing.icon_width_inner = 8.0;
    spacing.icon_spacing = UNIT;
    spacing.slider_width = 24.0 * UNIT;
    spacing.scroll = egui::style::ScrollStyle::thin();

    let visuals = &mut style.visuals;
    *visuals = if tokens.dark { egui::Visuals::dark() } else { egui::Visuals::light() };
    let [canvas, panel, control, popup] = tokens.surface;
    let radius = CornerRadius::same(3);
    visuals.panel_fill = panel;
    visuals.window_fill = popup;
    visuals.window_stroke = Stroke::new(1.0, tokens.line);
    visuals.window_corner_radius = CornerRadius::same(4);
    visuals.menu_corner_radius = CornerRadius::same(4);
    visuals.window_shadow =
        Shadow { offset: [0, 4], blur: 16, spread: 0, color: Color32::from_black_alpha(80) };
    visuals.popup_shadow =
        Shadow { offset: [0, 2], blur: 8, spread: 0, color: Color32::from_black_alpha(64) };
    visuals.extreme_bg_color = canvas;
    visuals.code_bg_color = control;
    visuals.faint_bg_color = panel.lerp_to_gamma(control, 0.35);
    visuals.hyperlink_color = tokens.accent;
    visuals.warn_fg_color = tokens.warning;
    visuals.error_fg_color = tokens.error;
    visuals.weak_text_color = Some(tokens.weak);
    visuals.selection.bg_fill = tokens.selected;
    visuals.selection.stroke = Stroke::new(1.0, if tokens.dark { tokens.strong } else { tokens.accent });
    visuals.slider_trailing_fill = true;
    visuals.indent_has_left_vline = false;

    let widgets = &mut visuals.widgets;
    for widget in [
        &mut widgets.noninteractive,
        &mut widgets.inactive,
        &mut widgets.hovered,
        &mut widgets.active,
        &mut widgets.open,
    ] {
        widget.corner_radius = radius;
        widget.expansion = 0.0;
        widget.bg_fill = control;
        widget.weak_bg_fill = control;
        widget.bg_stroke = Stroke::NONE;
        widget.fg_stroke = Stroke::new(1.0, tokens.text);
    }
    widgets.noninteractive.bg_fill = panel;
    widgets.noninteractive.weak_bg_fill = panel;
    widgets.noninteractive.bg_stroke = Stroke::new(1.0, tokens.line);
    let lift = |amount: f32| control.lerp_to_gamma(tokens.strong, amount);
    widgets.inactive.bg_fill = lift(0.06);
    widgets.hovered.bg_fill = lift(0.12);
    widgets.hovered.weak_bg_fill = lift(0.08);
    widgets.hovered.fg_stroke = Stroke::new(1.0, tokens.strong);
    widgets.active.bg_fill = lift(0.2);
    widgets.active.weak_bg_fill = lift(0.14);
    widgets.active.fg_stroke = Stroke::new(1.0, tokens.strong);
    widgets.open.weak_bg_fill = lift(0.08);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_in_the_colour_of_a_message_can_be_read_in_both_themes() {
        for (tokens, kept, replaced) in
            [(&DARK, Color32::WHITE, Color32::BLACK), (&LIGHT, Color32::BLACK, Color32::WHITE)]
        {
            assert_eq!([tokens.legible(kept), tokens.legible(replaced)], [kept, tokens.text]);
        }
    }

    #[test]
    fn text_and_states_can_be_read_on_every_surface() {
        for tokens in [&DARK, &LIGHT] {
            for surface in tokens.surface {
                for (name, color) in [("text", tokens.text), ("strong", tokens.strong), ("weak", tokens.weak)]
                {
                    let contrast = contrast(color, surface);
                    assert!(contrast >= 4.5, "{name} on {surface:?}, dark {}: {contrast}", tokens.dark);
                }
            }
            for color in [tokens.text, tokens.weak, tokens.strong, tokens.accent] {
                assert!(
                    contrast(color, tokens.selected) >= 4.5,
                    "{color:?} where selected, dark {}",
                    tokens.dark
                );
            }
            assert!(contrast(tokens.on_stop, tokens.stop) >= 4.5);
            assert!(contrast(tokens.on_warning, tokens.warning) >= 4.5);
            for color in [tokens.ok, tokens.warning, tokens.error, tokens.accent, tokens.stale] {
                let contrast = contrast(color, tokens.panel());
                assert!(contrast >= 4.5, "{color:?}, dark {}: {contrast}", tokens.dark);
            }
        }
    }

    #[test]
    fn series_can_be_told_from_the_canvas_and_from_each_other() {
        for tokens in [&DARK, &LIGHT] {
            for (i, color) in tokens.series.iter().enumerate() {
                assert!(contrast(*color, tokens.canvas()) >= 3.0, "{i}, dark {}", tokens.dark);
                for other in &tokens.series[..i] {
                    let distance: u32 = (0..3).map(|k| u32::from(color[k].abs_diff(other[k]))).sum();
                    assert!(distance > 70, "{color:?} {other:?}");
                }
            }
            // As many lines as the map of the stack `lagr` has.
            let lines: Vec<Color32> = (0..10).map(|line| tokens.series(line)).collect();
            assert!((0..10).all(|line| !lines[..line].contains(&lines[line])), "dark {}", tokens.dark);
        }
    }
}
