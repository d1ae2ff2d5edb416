//! A joystick with a dead-man's button, read through the kernel interface (`/dev/input/js*`) without a library.
//!
//! While a shoulder button is held, the left stick drives. Unplugging the joystick releases all controls.

use ocu_views::operator::Hand;
use std::fs::File;
use std::io::Read;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Devices that are tried.
const DEVICES: [&str; 4] = ["/dev/input/js0", "/dev/input/js1", "/dev/input/js2", "/dev/input/js3"];
/// Interval between attempts to open a joystick.
const LOOK_AGAIN: Duration = Duration::from_secs(3);
/// Deflections below this are ignored, because a released stick is not exactly centred.
const DEAD_ZONE: f64 = 0.12;
/// Number of steps of a full deflection, so that a trembling stick gives a constant command.
const STEPS: f64 = 20.0;

/// The shoulder buttons of most game pads.
const DEAD_MAN: [u8; 2] = [4, 5];
/// Axes of the left stick; positive to the right and towards the user.
const AXIS_X: u8 = 0;
const AXIS_Y: u8 = 1;

/// State of a joystick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Stick {
    x: f64,
    y: f64,
    held: [bool; DEAD_MAN.len()],
}

impl Stick {
    /// Processes one event of the kernel's `struct js_event`: time (u32), value (i16), kind (u8), number (u8).
    fn take(&mut self, event: [u8; 8]) {
        let [_, _, _, _, low, high, kind, number] = event;
        let value = i16::from_le_bytes([low, high]);
        // The highest bit marks initial states, which are processed like any other.
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

/// A joystick, found and read on a thread of its own.
#[derive(Debug, Default)]
pub(super) struct Joystick(Option<Arc<Mutex<Stick>>>);

impl Joystick {
    /// Starts the thread on the first call.
    pub(super) fn start(&mut self, ctx: &egui::Context) {
        if self.0.is_some() {
            return;
        }
        let stick: Arc<Mutex<Stick>> = Arc::default();
        self.0 = Some(Arc::clone(&stick));
        let (ctx, theirs) = (ctx.clone(), Arc::downgrade(&stick));
        let spawned = std::thread::Builder::new().name("joystick".to_owned()).spawn(move || {
            // The thread ends when the last user of the joystick is dropped.
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

    /// The deflection while the dead-man's button is held.
    pub(super) fn hand(&self) -> Hand {
        let Some(stick) = &self.0 else { return Hand::default() };
        stick.lock().unwrap_or_else(PoisonError::into_inner).hand()
    }
}

/// Reads until the joystick is unplugged or no longer used; then the deflection is zero.
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
