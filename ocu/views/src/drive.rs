//! Drive view: drives a vehicle by hand, and shows its motion and the progress of the course.
//!
//! Keys are handled by the window. The view adds buttons on the screen, and shows commanded and measured motion, why
//! the vehicle is stopped, and the results of the referee.

use crate::operator::{self, DriveLimits, DriveSettings, Hand, Inputs};
use crate::view::{View, ViewContext, is_old};
use egui::{
    Color32, CornerRadius, FontId, Rect, Role, ScrollArea, Sense, Stroke, StrokeKind, Ui, Vec2, WidgetInfo,
};
use ocu_ui::widgets::{self, mono, name_value};
use ocu_ui::{Icon, format, icons, tokens};
use rcs_msg::foxglove::Odometry;
use rcs_msg::rcs::{self, CourseOutcome};
use rcs_runtime::Role::{Mission, Pose};
use rcs_runtime::source::{Frame, Topic};

/// Width of the name column, and of that of the motion in a narrow view.
const NAMES: f32 = 80.0;
const NARROW_NAMES: f32 = 36.0;
/// Where less width is left for the motion, its columns are narrower, so that values keep their units.
const MOTION: f32 = 224.0;
/// Size of a drive button, and the gap between two of them.
const KEY: f32 = 44.0;
const GAP: f32 = 4.0;
/// Time for which the operator's command is shown as active after it was written.
const FRESH_S: f64 = 0.3;

/// The drive view.
#[derive(Default)]
pub(crate) struct Drive;

impl View for Drive {
    fn title(&self, _frame: &Frame) -> String {
        "Drive".to_owned()
    }

    fn ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>) {
        let inputs = Inputs::of(cx.frame);
        let vehicle = operator::vehicle(cx.frame);
        let run = cx.frame.topics_of_type("rcs.CourseRun").find_map(Topic::get::<rcs::CourseRun>);
        let stated = stated_mission(cx.frame);
        if inputs == Inputs::default() && vehicle.is_none() && run.is_none() {
            let hint = "A stack with a vehicle would fill it: start the program without a recording.";
            return widgets::empty(ui, icons::ICON_SPORTS_ESPORTS, "Nothing to drive", hint);
        }
        let rect = ui.available_rect_before_wrap().shrink(8.0);
        let mut child = ui.new_child(egui::UiBuilder::new().max_rect(rect));
        ScrollArea::vertical().auto_shrink(false).show(&mut child, |ui| {
            let roomy = ui.available_width() >= 360.0;
            let columns = |ui: &mut Ui| {
                ui.vertical(|ui| {
                    ui.set_width(3.0 * KEY + 2.0 * GAP + 8.0);
                    if let Some(teleop) = &inputs.teleop {
                        let stopped = stopped(cx.frame, &inputs, cx.selection.can_release);
                        pad(ui, cx, teleop, stopped);
                    }
                });
                ui.vertical(|ui| {
                    (ui.spacing_mut().item_spacing.y, ui.spacing_mut().interact_size.y) = (2.0, 16.0);
                    if let Some(run) = run {
                        course(ui, run, stated.is_some());
                        if stated.is_none() && looks_for_goal(cx.frame, run, vehicle) {
                            let text = "The stack still looks for it, by its own estimate of the position.";
                            let text = egui::RichText::new(text).small().color(tokens(ui).weak);
                            ui.add(egui::Label::new(text).wrap());
                        }
                    }
                    if let Some(stated) = stated {
                        mission(ui, cx.frame, stated);
                    }
                    ui.add_space(8.0);
                    motion(ui, cx.frame, &inputs, vehicle);
                });
            };
            if roomy { ui.horizontal_top(columns).inner } else { ui.vertical(columns).inner }
        });
        ui.advance_cursor_after_rect(rect);
    }
}

/// What the operator is told while the vehicle obeys an emergency stop, or the operator has sent one; `None` while nothing is
/// stopped. `can_release`: whether the bar at the top has the button *Release*.
fn stopped(frame: &Frame, inputs: &Inputs, can_release: bool) -> Option<&'static str> {
    let obeys = operator::vehicle(frame).is_some_and(|(_, status)| status.emergency_stopped);
    let Some(buffer) = inputs.emergency_stop.as_deref() else {
        let told = "Emergency stop: the controls do not drive, and it cannot be released from here.";
        return obeys.then_some(told);
    };
    let sent = frame.topic(buffer).and_then(|topic| topic.get::<rcs::EmergencyStop>());
    let asks = sent.is_some_and(|stop| stop.active);
    (obeys || asks).then_some(match (can_release, sent.is_some() && !asks) {
        (true, _) => "Emergency stop: let go of the keys, and press Release at the upper right to drive.",
        (false, true) => {
            "Emergency stop: the controls do not drive, and the vehicle has not confirmed its release."
        }
        (false, false) => "Emergency stop: the controls do not drive, and the vehicle has not confirmed it.",
    })
}

/// Four buttons that drive while they are pressed, highlighted for the current command, and the speed settings. None of
/// them drives while time or the vehicle is stopped; `stopped` is what is told of the vehicle then.
fn pad(ui: &mut Ui, cx: &mut ViewContext<'_>, teleop: &str, stopped: Option<&str>) {
    let playing = cx.frame.playback.playing;
    let command = commanded(cx.frame, teleop);
    let [speed, turn] =
        command.map_or([0.0; 2], |command| [command.speed_mps, command.yaw_rate_radps.unwrap_or(0.0)]);
    let (area, _) = ui.allocate_exact_size(Vec2::new(3.0 * KEY + 2.0 * GAP, 2.0 * KEY + GAP), Sense::hover());
    let keys = [
        (icons::ICON_ARROW_UPWARD, "W", "Drive forward", [1.0, 0.0_f32], hand(1.0, 0.0), speed > 0.0),
        (icons::ICON_ARROW_BACK, "A", "Turn left", [0.0, 1.0_f32], hand(0.0, 1.0), turn > 0.0),
        (icons::ICON_ARROW_DOWNWARD, "S", "Drive backward", [1.0, 1.0_f32], hand(-1.0, 0.0), speed < 0.0),
        (icons::ICON_ARROW_FORWARD, "D", "Turn right", [2.0, 1.0_f32], hand(0.0, -1.0), turn < 0.0),
    ];
    for (icon, letter, name, place, push, lit) in keys {
        let min = area.min + Vec2::from(place) * (KEY + GAP);
        let place = Rect::from_min_size(min, Vec2::splat(KEY));
        if key(ui, place, icon, letter, name, lit, playing && stopped.is_none()) {
            cx.selection.hand = cx.selection.hand.with(push);
        }
    }
    ui.add_space(2.0);
    let weak = tokens(ui).weak;
    let note = |ui: &mut Ui, text: &str, color: Color32| {
        ui.add(egui::Label::new(egui::RichText::new(text).small().color(color)).wrap());
    };
    if let Some(text) = stopped.filter(|_| playing) {
        note(ui, text, tokens(ui).warning);
    } else if cx.selection.let_go_first && playing {
        note(ui, "Let go of the controls first: nothing drives until they are neutral.", tokens(ui).warning);
    } else if playing {
        note(ui, "Hold W A S D; with shift, slowly.", weak);
        if operator::stack_drives(cx.frame) {
            let text = "When you let go, the stack takes over again: press Esc to keep it standing.";
            note(ui, text, weak);
        }
    } else {
        note(ui, "Time stands: play (space) to drive.", tokens(ui).warning);
    }
    ui.add_space(2.0);
    let limits = DriveLimits::of(cx.frame);
    let settings = &mut cx.selection.drive;
    let within = settings.within(limits);
    ui.spacing_mut().slider_width = 56.0;
    // The vehicle refuses what is faster than its limits, so nothing faster is offered.
    let mut speed_mps = within.speed_mps;
    if slider(ui, "Speed", &mut speed_mps, 0.1_f64.min(limits.speed_mps)..=limits.speed_mps, " m/s") {
        settings.speed_mps = speed_mps;
    }
    let most = limits.turn_radps.to_degrees().floor().max(1.0);
    let mut degrees = within.turn_radps.to_degrees().round().min(most);
    if slider(ui, "Turn", &mut degrees, 5.0_f64.min(most)..=most, " °/s") {
        settings.turn_radps = degrees.to_radians();
    }
    let usual = |ui: &mut Ui| ui.small_button("Usual speeds").clicked();
    if *settings != DriveSettings::default() && widgets::named(ui, "usual", usual) {
        *settings = DriveSettings::default();
    }
}

fn slider(
    ui: &mut Ui,
    name: &str,
    value: &mut f64,
    range: std::ops::RangeInclusive<f64>,
    unit: &str,
) -> bool {
    // The notes above come and go while it is dragged.
    let row = |ui: &mut Ui| {
        let weak = tokens(ui).weak;
        let (rect, _) = ui.allocate_exact_size(Vec2::new(36.0, 16.0), Sense::hover());
        ui.painter().text(
            rect.left_center(),
            egui::Align2::LEFT_CENTER,
            name,
            FontId::proportional(12.0),
            weak,
        );
        let decimals = usize::from(*range.end() < 10.0);
        let slider = egui::Slider::new(value, range).suffix(unit).fixed_decimals(decimals);
        let response = ui.add(slider);
        let label = format!("{name} of a full push");
        response.widget_info(|| WidgetInfo::labeled(Role::Slider, true, &label));
        response.on_hover_text(&label).changed()
    };
    widgets::named(ui, name, |ui| ui.horizontal(row).inner)
}

fn hand(forward: f64, left: f64) -> Hand {
    Hand { forward, left, slow: false }
}

/// One button; returns whether it is pressed.
fn key(ui: &mut Ui, rect: Rect, icon: Icon, letter: &str, name: &str, lit: bool, enabled: bool) -> bool {
    let tokens = tokens(ui);
    let response = ui.interact(rect, ui.scope_id().with(name), Sense::click_and_drag());
    response.widget_info(|| WidgetInfo::selected(Role::Button, enabled, lit, name));
    let pressed = enabled && response.is_pointer_button_down_on();
    let (fill, ink) = match (lit || pressed, enabled) {
        (true, _) => (tokens.selected, tokens.strong),
        (false, true) => (tokens.surface[2], tokens.text),
        (false, false) => (tokens.panel(), tokens.unknown),
    };
    let edge = if lit || pressed || (enabled && response.hovered()) { tokens.accent } else { tokens.line };
    let painter = ui.painter();
    painter.rect(rect, CornerRadius::same(4), fill, Stroke::new(1.0, edge), StrokeKind::Inside);
    widgets::icon_at(painter, rect.center() - Vec2::new(0.0, 3.0), icon, 20.0, ink);
    let at = rect.center_bottom() - Vec2::new(0.0, 4.0);
    let weak = if lit || pressed { tokens.strong } else { tokens.weak };
    painter.text(at, egui::Align2::CENTER_BOTTOM, letter, FontId::proportional(10.0), weak);
    // While time runs, a tooltip would cover the neighbouring buttons of a person who drives.
    if !enabled {
        response.on_hover_text(name);
    }
    pressed
}

/// The operator's command, while it is active.
fn commanded<'a>(frame: &'a Frame, teleop: &str) -> Option<&'a rcs::DriveCommand> {
    let topic = frame.topic(teleop)?;
    let fresh = topic.age_s(frame.now).is_some_and(|age_s| age_s <= FRESH_S);
    topic.get().filter(|_| fresh)
}

/// Commanded and measured motion of the vehicle.
fn motion(ui: &mut Ui, frame: &Frame, inputs: &Inputs, vehicle: Option<(&Topic, &rcs::VehicleStatus)>) {
    let tokens = tokens(ui);
    let Some((topic, status)) = vehicle else {
        ui.label(egui::RichText::new("The vehicle has not said anything yet.").color(tokens.weak));
        return;
    };
    let age_s = topic.age_s(frame.now).unwrap_or(0.0);
    let old = is_old(topic, frame.now);
    let (word, color) = match (old, status.emergency_stopped, status.stopped) {
        (true, ..) => (format!("NO STATUS FOR {}", format::age(age_s)), tokens.stale),
        (_, true, _) => ("EMERGENCY STOP".to_owned(), tokens.error),
        (_, _, true) => ("HELD".to_owned(), tokens.warning),
        _ => ("FREE TO MOVE".to_owned(), tokens.ok),
    };
    let person = inputs.teleop.as_deref().and_then(|teleop| commanded(frame, teleop));
    let who = match person {
        Some(_) => "you",
        None if status.teleoperated => "the operator",
        None if status.stopped => "nobody",
        None => "the stack",
    };
    // Beside the state, because in a low view what is at the end is cut off.
    ui.horizontal_wrapped(|ui| {
        widgets::tag(ui, &word, color);
        ui.label(egui::RichText::new("driven by").size(12.0).color(tokens.weak));
        ui.label(who);
    });
    if !status.stop_reason.is_empty() && !old && !status.emergency_stopped {
        ui.add(egui::Label::new(&status.stop_reason).wrap());
    }
    let (names, digits, gap, head) = if ui.available_width() < MOTION {
        (NARROW_NAMES, 5, " ", "wanted  now")
    } else {
        (NAMES, 6, "  ", "wanted    now")
    };
    let dash = || format!("{:>digits$}", "–");
    let or_dash = |value: f64, text: String| if value.is_nan() { dash() } else { text };
    // Rounded first, so that a small negative number is not shown as "-0.0".
    let turn = |radps: f64| {
        or_dash(radps, format!("{:digits$.1}", (radps.to_degrees() * 10.0).round() / 10.0 + 0.0))
    };
    let wanted_turn = person.and_then(|command| command.yaw_rate_radps).map_or_else(dash, turn);
    let ink = if old { tokens.stale } else { tokens.text };
    let row = |ui: &mut Ui, name: &str, wanted: String, measured: String, unit: &str| {
        name_value(ui, names, name, mono(format!("{wanted}{gap}{measured} {unit}")).color(ink));
    };
    name_value(ui, names, "", mono(head).color(tokens.weak));
    let speed = |mps: f64| or_dash(mps, format!("{:digits$.2}", (mps * 100.0).round() / 100.0 + 0.0));
    let [wanted, now] = [status.wanted_speed_mps, status.speed_mps].map(speed);
    row(ui, "Speed", wanted, now, "m/s");
    row(ui, "Turn", wanted_turn, turn(status.yaw_rate_radps), "°/s");
    // Measured only: nobody wants an attitude.
    row(ui, "Roll", dash(), turn(status.roll_rad), "°");
    row(ui, "Pitch", dash(), turn(status.pitch_rad), "°");
    if status.refused > 0 {
        let times = if status.refused == 1 { "once".to_owned() } else { format!("{} times", status.refused) };
        name_value(ui, NAMES, "Refused", egui::RichText::new(times).color(tokens.warning));
        let reason = egui::RichText::new(&status.last_refusal).color(tokens.warning);
        ui.add(egui::Label::new(reason).wrap());
    }
}

/// The mission that the vehicle obeys, if it has goals.
fn stated_mission(frame: &Frame) -> Option<&rcs::Mission> {
    let missions = frame.topics_of_type("rcs.Mission").filter(|topic| topic.role() == Some(Mission));
    missions.filter_map(Topic::get::<rcs::Mission>).find(|it| !it.goals.is_empty())
}

/// Distance from the estimated position of the vehicle to the goal of its mission that it drives to, m; `None` where all
/// were reached, or no position is known in the frame of the mission.
fn to_next_goal_m(frame: &Frame, mission: &rcs::Mission) -> Option<f64> {
    let goal = mission.goals.get(mission.reached as usize)?;
    let poses = frame.topics_of_type("foxglove.Odometry");
    let poses = poses.filter(|topic| topic.role() == Some(Pose) && !topic.is_ground_truth());
    let mut poses = poses.filter_map(Topic::get::<Odometry>);
    let pose = poses.find(|pose| pose.frame_id == mission.frame_id)?.pose.as_ref()?;
    let at = pose.position?;
    Some((goal.x_m - at.x).hypot(goal.y_m - at.y))
}

/// How many of the goals that the operator has sent are reached, and how far the next one is.
fn mission(ui: &mut Ui, frame: &Frame, mission: &rcs::Mission) {
    let (reached, all) = (mission.reached as usize, mission.goals.len());
    let color = if reached >= all { tokens(ui).ok } else { tokens(ui).text };
    let text = if all == 1 && reached == 1 {
        "goal reached".to_owned()
    } else {
        format!("{reached} of {all} goal{} reached", if all == 1 { "" } else { "s" })
    };
    name_value(ui, NAMES, "Mission", egui::RichText::new(text).color(color)).on_hover_text(
        "The goals that were sent to the robot; they take the place of the goal of the course.",
    );
    if let Some(distance_m) = to_next_goal_m(frame, mission) {
        name_value(ui, NAMES, "Next goal", mono(format!("{distance_m:6.1} m")))
            .on_hover_text("To the next goal of the mission, from the estimated position.");
    }
}

/// Whether the stack drives on although the referee, who knows the true position, says that the goal is reached.
fn looks_for_goal(
    frame: &Frame,
    run: &rcs::CourseRun,
    vehicle: Option<(&Topic, &rcs::VehicleStatus)>,
) -> bool {
    let drives = |status: &rcs::VehicleStatus| {
        !status.stopped && !status.teleoperated && status.wanted_speed_mps.abs() > 0.0
    };
    run.outcome() == CourseOutcome::CourseReached
        && operator::stack_drives(frame)
        && vehicle.is_some_and(|(_, status)| drives(status))
}

/// Progress of the course; `has_mission`: whether the vehicle drives to other goals than that of the course.
fn course(ui: &mut Ui, run: &rcs::CourseRun, has_mission: bool) {
    let tokens = tokens(ui);
    let (icon, word, color) = match run.outcome() {
        CourseOutcome::CourseRunning => (icons::ICON_FLAG, "RUNNING", tokens.accent),
        CourseOutcome::CourseReached => (icons::ICON_CHECK, "GOAL REACHED", tokens.ok),
        CourseOutcome::CourseTimeOut => (icons::ICON_TIMER_OFF, "OUT OF TIME", tokens.error),
        CourseOutcome::CourseLost => (icons::ICON_ERROR, "LOST", tokens.error),
    };
    ui.horizontal(|ui| {
        ui.label(icon.rich_text().size(14.0).color(color));
        widgets::tag(ui, word, color);
        let name = if run.course.is_empty() { "no course" } else { &run.course };
        ui.add(egui::Label::new(egui::RichText::new(name).color(tokens.strong)).truncate());
    });
    let minutes = |s: f64| format!("{}:{:04.1}", (s / 60.0).floor(), s % 60.0);
    let limit = (run.time_limit_s > 0.0).then(|| format!(" of {}", minutes(run.time_limit_s)));
    let time = minutes(run.time_s) + &limit.unwrap_or_default();
    name_value(ui, NAMES, "Time", mono(time));
    let goal = if has_mission { "Course goal" } else { "To the goal" };
    name_value(ui, NAMES, goal, mono(format!("{:6.1} m", run.remaining_m))).on_hover_text(
        "To the goal of the course, from the true position, as the referee of the simulation has it. The map measures from \
         the estimated one.",
    );
    name_value(ui, NAMES, "Driven", mono(format!("{:6.1} m", run.distance_m)));
    let count = |ui: &mut Ui, name: &str, count: u32, bad: Color32| {
        let text = mono(format!("{count:4}")).color(if count > 0 { bad } else { tokens.text });
        name_value(ui, NAMES, name, text);
    };
    count(ui, "Collisions", run.collisions, tokens.error);
    count(ui, "Bumper hits", run.bumper_hits, tokens.warning);
    name_value(ui, NAMES, "Slipping", mono(format!("{:6.1} s", run.slip_s)));
}
