//! The link of a city that is served here or watched elsewhere: who leads, what comes, and what does not work.

use super::{CityKind, ViewModel, theme};
use city3d_protocol::snapshot::Status;
use city3d_session::{EndStatus, LinkStatus};
use egui::{Color32, RichText, Ui};

/// Diameter of the lamp, points.
const LAMP: f32 = 11.0;

/// Shows the link in a few words; the tooltip has its counters.
pub fn show(ui: &mut Ui, link: &LinkStatus, shown: &ViewModel<'_>) {
    let warning = ui.visuals().warn_fg_color;
    let failed = shown.run_state.ends.iter().any(|end| end.failure.is_some());
    let colour = match (link.trouble.is_some() || failed, link.received_per_s > 0.0) {
        (true, _) => warning,
        (false, true) => theme::on_panel(ui.ctx(), Status::Driving),
        (false, false) => theme::on_panel(ui.ctx(), Status::Waiting),
    };
    let mut text = RichText::new(words(link, shown.city));
    if link.trouble.is_some() {
        text = text.color(warning);
    }
    let tip = details(link, &shown.run_state.ends);
    lamp(ui, colour).on_hover_text(&tip);
    ui.add(egui::Label::new(text).extend()).on_hover_text(&tip);
    for end in shown.run_state.ends.iter().filter(|end| end.failure.is_some()) {
        let why = end.failure.as_deref().unwrap_or_default();
        let text = RichText::new(format!("{} \u{26a0}", name(&end.name))).color(warning);
        ui.label(text).on_hover_text(format!("{}: {why}; the city goes on without", name(&end.name)));
    }
}

/// Why there are no vehicles, and who brings them.
pub fn absence(shown: &ViewModel<'_>) -> String {
    let link = shown.run_state.link.as_deref();
    match (shown.city, link) {
        (CityKind::Served, Some(link)) => format!(
            "The control framework brings the vehicles. On this machine:\ncity3d mainframe {} --city {}",
            shown.scenario, link.address
        ),
        (CityKind::Elsewhere, Some(LinkStatus { trouble: Some(trouble), .. })) => format!("{trouble}."),
        (CityKind::Elsewhere, _) => "The city has no vehicles yet.".to_owned(),
        // Drivers are known of all vehicles of the scenario, also of those that have yet to come.
        _ if !shown.drivers.is_empty() => "No vehicle is in the city now; they arrive by inflows.".to_owned(),
        _ => "This scenario has no vehicles.".to_owned(),
    }
}

/// A small lamp: no font is sure to have one.
fn lamp(ui: &mut Ui, colour: Color32) -> egui::Response {
    let (rect, response) = ui.allocate_exact_size(egui::Vec2::splat(LAMP), egui::Sense::hover());
    ui.painter().circle_filled(rect.center(), LAMP * 0.42, colour);
    response
}

/// The state of the link in a few words.
fn words(link: &LinkStatus, city: CityKind) -> String {
    if let Some(trouble) = &link.trouble {
        return trouble.clone();
    }
    // The bar has one row at 1280 points.
    match city {
        CityKind::Elsewhere => format!("watching {}", link.address),
        CityKind::Local | CityKind::Served => leader(link),
    }
}

fn leader(link: &LinkStatus) -> String {
    link.leader.as_deref().map_or_else(|| "nobody leads".to_owned(), |who| format!("{who} leads"))
}

/// Everything that is counted of the link and of the ends of the session.
fn details(link: &LinkStatus, ends: &[EndStatus]) -> String {
    let place = if link.is_remote { "Watching" } else { "Served on udp" };
    let mut lines = vec![
        format!("{place} {}, {}", link.address, leader(link)),
        format!("{:.0} datagrams per second come in", link.received_per_s),
    ];
    if !link.is_remote {
        lines.push(format!("{} subscribed to poses", link.subscribers));
        lines.push(format!("{} missing, {} dropped since the start", link.missing, link.dropped));
    }
    for EndStatus { name: of, delivered, dropped, failure } in ends {
        let state = failure.as_ref().map_or_else(String::new, |why| format!(" ({why})"));
        lines.push(format!("{}: {delivered} delivered, {dropped} dropped{state}", name(of)));
    }
    lines.join("\n")
}

/// An end of the session as people call it.
fn name(end: &str) -> &str {
    match end {
        "udp" => "Poses over UDP",
        "ros" => "ROS",
        "ros2" => "ROS 2",
        "pictures" => "Onboard pictures",
        "files" => "Log",
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_words_say_who_leads_or_what_is_wrong() {
        let mut link = LinkStatus { address: "127.0.0.1:9870".to_owned(), ..LinkStatus::default() };
        assert_eq!(words(&link, CityKind::Served), "nobody leads");
        link.leader = Some("127.0.0.1:4000".to_owned());
        assert_eq!(words(&link, CityKind::Elsewhere), "watching 127.0.0.1:9870");
        assert!(details(&link, &[]).starts_with("Served on udp 127.0.0.1:9870, 127.0.0.1:4000 leads"));
        link.trouble = Some("127.0.0.1:9870: nothing listens there".to_owned());
        assert_eq!(words(&link, CityKind::Served), "127.0.0.1:9870: nothing listens there");
    }
}
