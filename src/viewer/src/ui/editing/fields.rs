//! Fields of the editor: each tells of a change when it is left, so that half a name or half a number is none.

use crate::ui::{DecimalSeparator, theme};
use city3d_geometry::trig;
use egui::{ComboBox, Id, Key, Response, RichText, TextEdit, Ui};
use std::ops::RangeInclusive;

/// A text; `typed` keeps it while the field has the keyboard.
pub(super) fn text(
    ui: &mut Ui,
    (label, width): (Id, f32),
    present: &str,
    typed: &mut Option<String>,
) -> Option<String> {
    let mut new = typed.take().unwrap_or_else(|| present.to_owned());
    let field = ui.add(TextEdit::singleline(&mut new).desired_width(width)).labelled_by(label);
    told(&field, new, present, typed)
}

/// What was typed, once the field is left; meanwhile `typed` keeps it.
fn told(field: &Response, new: String, present: &str, typed: &mut Option<String>) -> Option<String> {
    if field.lost_focus() {
        return (new != present).then_some(new);
    }
    if field.has_focus() {
        *typed = Some(new);
    }
    None
}

/// Most height of a long text, points: three lines.
const LONG_TEXT_HEIGHT: f32 = 58.0;

/// A text that may be longer than its field, which grows with it up to three lines; otherwise as [`text`]. Enter leaves it: it is one line in the
/// file.
pub(super) fn long_text(
    ui: &mut Ui,
    (label, width): (Id, f32),
    present: &str,
    typed: &mut Option<String>,
) -> Option<String> {
    let mut new = typed.take().unwrap_or_else(|| present.to_owned());
    let field = TextEdit::multiline(&mut new).return_key(None).desired_rows(1).desired_width(width);
    // A field of many lines would leave no room for those below.
    let lines = egui::ScrollArea::vertical().id_salt("long text").max_height(LONG_TEXT_HEIGHT);
    let field = lines.show(ui, |ui| ui.add(field)).inner.labelled_by(label);
    if field.has_focus() && ui.input(|input| input.key_pressed(Key::Enter)) {
        field.surrender_focus();
    }
    // What is pasted may have several lines.
    new = new.replace('\n', " ");
    if !field.has_focus() && new != present {
        return Some(new);
    }
    told(&field, new, present, typed)
}

/// Name of the choice that is written as no key at all.
pub(super) const DEFAULT: &str = "default";

/// A choice of names.
pub(super) struct Choice<'a> {
    pub label: &'a str,
    pub tip: &'a str,
    /// What is stated now.
    pub stated: Option<&'a str>,
    /// All names; [`DEFAULT`] stands for none.
    pub names: &'a [String],
    /// What is shown where none is stated.
    pub unstated: &'a str,
    /// What a name means, where there is more to say than the name.
    pub meaning: &'a dyn Fn(&str) -> String,
}

impl Choice<'_> {
    /// Shows it; returns another choice: a name, or none.
    pub fn show(&self, ui: &mut Ui) -> Option<Option<String>> {
        let present = self.stated.unwrap_or(DEFAULT);
        let mut chosen = None;
        let id = ui.label(self.label).on_hover_text(self.tip).id;
        let list = ComboBox::from_id_salt(self.label)
            .selected_text(self.stated.unwrap_or(self.unstated))
            .width(ui.spacing().combo_width)
            .truncate();
        let list = list.show_ui(ui, |ui| {
            for name in self.names {
                let text = if name == DEFAULT { self.unstated } else { name };
                let mut choice = ui.selectable_label(name == present, text);
                let meaning = (self.meaning)(name);
                if !meaning.is_empty() {
                    choice = choice.on_hover_text(meaning);
                }
                if choice.clicked() && name != present {
                    chosen = Some((name != DEFAULT).then(|| name.clone()));
                }
            }
        });
        let (list, meaning) = (list.response.labelled_by(id), (self.meaning)(present));
        if !meaning.is_empty() {
            list.on_hover_text(meaning);
        }
        chosen
    }
}

/// A number with a unit, between two bounds.
pub(super) struct Number<'a> {
    pub label: &'a str,
    pub tip: String,
    /// Whose it is: what was refused of one vehicle says nothing of another.
    pub of: u32,
    pub value: f64,
    pub range: RangeInclusive<f64>,
    pub unit: &'a str,
    pub decimals: usize,
    pub decimal: DecimalSeparator,
}

impl Number<'_> {
    /// Shows it; returns another number. One beyond the bounds is refused beside the field. While it is dragged it is
    /// kept aside, so that the whole drag is one change.
    pub fn show(self, ui: &mut Ui) -> Option<f64> {
        let kept = ui.scope_id().with(("edited", self.label, self.of));
        let refused = kept.with("refused");
        let label = ui.label(self.label).on_hover_text(&self.tip).id;
        let row = ui.horizontal(|ui| {
            let mut new = ui.data(|data| data.get_temp::<f64>(kept)).unwrap_or(self.value);
            let (decimal, decimals) = (self.decimal, self.decimals);
            let field = theme::number_field(&mut new)
                .speed(if decimals > 2 { 0.01 } else { 0.25 })
                .custom_formatter(move |number, _| decimal.fixed(number, decimals))
                .suffix(format!(" {}", self.unit));
            let field = ui.add(field).labelled_by(label).on_hover_text(&self.tip);
            if field.dragged() {
                new = new.clamp(*self.range.start(), *self.range.end());
            }
            if field.dragged() || field.has_focus() {
                ui.data_mut(|data| {
                    data.insert_temp(kept, new);
                    data.remove::<String>(refused);
                });
                return None;
            }
            ui.data_mut(|data| data.remove::<f64>(kept));
            let is_done = field.drag_stopped() || field.lost_focus();
            let is_allowed = self.range.contains(&new);
            if is_done && !is_allowed {
                ui.data_mut(|data| data.insert_temp(refused, self.refusal()));
            }
            if let Some(words) = ui.data(|data| data.get_temp::<String>(refused)) {
                ui.label(RichText::new(words).small().color(ui.visuals().error_fg_color));
            }
            (is_done && is_allowed && (new - self.value).abs() > 1e-9).then_some(new)
        });
        row.inner
    }

    /// What would be right; what was typed may be too long to be told beside the field.
    fn refusal(&self) -> String {
        let steps = trig::powi(10.0, self.decimals as u32);
        // Rounded inwards, so that what is told is allowed.
        let to = (self.range.end() * steps + 1e-6).floor() / steps;
        let [from, to] = [*self.range.start(), to].map(|number| self.decimal.plain(number));
        format!("refused: only {from} to {to}")
    }
}
