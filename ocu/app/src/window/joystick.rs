//! A joystick with a dead-man's button, through the kernel's own interface (`/dev/input/js*`): no library is needed.
//!
//! While a shoulder button is held, the left stick drives. A stick that is unplugged lets go of everything.

use ocu_views::operator::Hand;
use std::fs::File;
use std::io::Read;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Devices that are looked for.
const DEVICES: [&str; 4] = ["/dev/input/js0", "/dev/input/js1", "/dev/input/js2", "/dev/input/js3"];
/// How often a stick is looked for that is not there.
const LOOK_AGAIN: Duration = Duration::from_secs(3);
/// A stick that rests is not quite in the middle.
const DEAD_ZONE: f64 = 0.12;
/// Steps of a full push: a stick that trembles asks for the same.
const STEPS: f64 = 20.0;

/// The shoulder buttons of nearly every game pad.
const DEAD_MAN: [u8; 2] = [4, 5];
/// Axes of the left stick; both grow to the right and towards the person.
const AXIS_X: u8 = 0;
const AXIS_Y: u8 = 1;

/// What a stick says.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Stick {
    x: f64,
    y: f64,
    held: [bool; DEAD_MAN.len()],
}

impl Stick {
    /// Takes one event of the kernel's `struct js_event`: time (u32), value (i16), kind (u8), number (u8).
    fn take(&mut self, event: [u8; 8]) {
        let [_, _, _, _, low, high, kind, number] = event;
        let value = i16::from_le_bytes([low, high]);
        // The highest bit marks the state at the beginning, which counts like any other.
        match kind & 0x7f {
            1 => {
                if let Some(button) = DEAD_MAN.iter().position(|&button| button == number) {
                    self.held[button] = value != 0;
                }
            }
            2 => {
                let part = f64::from(value) / f64::from(i16::MAX);
                match number {
                    AXIS_X => self.x = part,
                    AXIS_Y => self.y = part,
                    _ => {}
                }
            }
            _ => {}
        }
    }

    fn hand(self) -> Hand {
        if !self.held.contains(&true) {
            return Hand::default();
        }
        let push = |part: f64| {
            let beyond = ((part.abs() - DEAD_ZONE) / (1.0 - DEAD_ZONE)).clamp(0.0, 1.0);
            ((beyond * STEPS).round() / STEPS).copysign(part) + 0.0
        };
        Hand { forward: push(-self.y), left: push(-self.x), slow: false }
    }
}

/// A joystick, looked for and read on a thread of its own that waits for it.
#[derive(Debug, Default)]
pub(super) struct Joystick(Option<Arc<Mutex<Stick>>>);

impl Joystick {
    /// Begins to look for one, the first time.
    pub(super) fn start(&mut self, ctx: &egui::Context) {
        if self.0.is_some() {
            return;
        }
        let stick: Arc<Mutex<Stick>> = Arc::default();
        self.0 = Some(Arc::clone(&stick));
        let (ctx, theirs) = (ctx.clone(), Arc::downgrade(&stick));
        let spawned = std::thread::Builder::new().name("joystick".to_owned()).spawn(move || {
            // The thread ends with the last one that looks at the stick.
            while let Some(stick) = theirs.upgrade() {
                if let Some(mut device) = DEVICES.iter().find_map(|path| File::open(path).ok()) {
                    read(&mut device, &stick, &ctx);
                }
                drop(stick);
                std::thread::sleep(LOOK_AGAIN);
            }
        });
        if let Err(error) = spawned {
            tracing::warn!("no thread for a joystick: {error}");
        }
    }

    /// Where it pushes while its dead-man's button is held.
    pub(super) fn hand(&self) -> Hand {
        let Some(stick) = &self.0 else { return Hand::default() };
        stick.lock().unwrap_or_else(PoisonError::into_inner).hand()
    }
}

/// Reads until the stick is unplugged or nobody looks at it any more; then it pushes nowhere.
fn read(device: &mut impl Read, stick: &Arc<Mutex<Stick>>, ctx: &egui::Context) {
    let mut event = [0; 8];
    while device.read_exact(&mut event).is_ok() && Arc::strong_count(stick) > 1 {
        stick.lock().unwrap_or_else(PoisonError::into_inner).take(event);
        ctx.request_repaint();
    }
    *stick.lock().unwrap_or_else(PoisonError::into_inner) = Stick::default();
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(value: i16, kind: u8, number: u8) -> [u8; 8] {
        let [low, high] = value.to_le_bytes();
        [1, 2, 3, 4, low, high, kind, number]
    }

    #[test]
    fn a_stick_pushes_only_while_its_dead_mans_button_is_held() {
        let mut stick = Stick::default();
        stick.take(event(-i16::MAX, 2, AXIS_Y));
        stick.take(event(i16::MAX / 2, 0x82, AXIS_X));
        assert_eq!(stick.hand(), Hand::default());
        stick.take(event(1, 1, 5));
        let hand = stick.hand();
        assert_eq!(hand.forward, 1.0);
        assert!((-0.5..-0.3).contains(&hand.left), "{hand:?}");
        stick.take(event(1, 1, 0));
        stick.take(event(0, 1, 5));
        assert_eq!(stick.hand(), Hand::default(), "another button is no dead-man's button");
    }

    #[test]
    fn a_stick_that_rests_off_the_middle_pushes_nowhere() {
        let mut stick = Stick::default();
        stick.take(event(1, 1, 4));
        stick.take(event(3000, 2, AXIS_X));
        stick.take(event(-3000, 2, AXIS_Y));
        assert!(!stick.hand().pushes());
    }

    #[test]
    fn a_stick_that_is_unplugged_lets_go() {
        let stick: Arc<Mutex<Stick>> = Arc::default();
        let looks = Arc::clone(&stick);
        let bytes: Vec<u8> = [event(1, 1, 4), event(-i16::MAX, 2, AXIS_Y)].concat();
        read(&mut [&bytes[..], &[1, 2, 3]].concat().as_slice(), &stick, &egui::Context::default());
        assert_eq!(*looks.lock().unwrap(), Stick::default());
    }
}
