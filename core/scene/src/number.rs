//! One number, or one of each ray of a packet: what is computed with both is written once, so both give the same bits.
//!
//! Where two numbers are 0, the sign of the smaller or larger one depends on the processor; no result depends on it.

use std::ops::{Add, Div, Mul, Sub};

use glam::Vec4;

/// `f32`, or a vector of them.
pub(crate) trait Number:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    fn of(value: f32) -> Self;

    /// `f32::min` without NaN handling, which compiles to one instruction; none of the numbers is NaN.
    fn smaller(self, other: Self) -> Self;

    /// `f32::max` without NaN handling.
    fn larger(self, other: Self) -> Self;

    fn abs(self) -> Self;

    /// `then` where this number is above `limit`, else `otherwise`.
    fn if_above(self, limit: f32, then: Self, otherwise: Self) -> Self;
}

impl Number for f32 {
    #[inline]
    fn of(value: f32) -> f32 {
        value
    }

    #[inline]
    fn smaller(self, other: f32) -> f32 {
        if self < other { self } else { other }
    }

    #[inline]
    fn larger(self, other: f32) -> f32 {
        if self > other { self } else { other }
    }

    #[inline]
    fn abs(self) -> f32 {
        f32::abs(self)
    }

    #[inline]
    fn if_above(self, limit: f32, then: f32, otherwise: f32) -> f32 {
        if self > limit { then } else { otherwise }
    }
}

impl Number for Vec4 {
    #[inline]
    fn of(value: f32) -> Vec4 {
        Vec4::splat(value)
    }

    #[inline]
    fn smaller(self, other: Vec4) -> Vec4 {
        self.min(other)
    }

    #[inline]
    fn larger(self, other: Vec4) -> Vec4 {
        self.max(other)
    }

    #[inline]
    fn abs(self) -> Vec4 {
        Vec4::abs(self)
    }

    #[inline]
    fn if_above(self, limit: f32, then: Vec4, otherwise: Vec4) -> Vec4 {
        Vec4::select(self.cmpgt(Vec4::splat(limit)), then, otherwise)
    }
}
