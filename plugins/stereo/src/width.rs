//! The widest vectors of the processor, selected at run time.
//!
//! A kernel is plain integer code over slices, which the compiler vectorizes once for each width below. Integer results
//! do not depend on the width, so all widths give the same result bit for bit; the tests run each of them.

/// A computation that is compiled for each vector width. `run`, and everything that it calls in its inner loops, must
/// be `#[inline(always)]`.
pub(crate) trait Kernel {
    /// Runs the computation.
    fn run(self);
}

/// Instruction sets for which kernels are compiled.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Width {
    /// What every processor of the target has: 16 bytes on x86-64.
    Baseline,
    /// AVX2: 32 bytes.
    Avx2,
    /// AVX-512 with byte and word instructions: 64 bytes.
    Avx512,
}

impl Width {
    /// The widths that this processor supports, in ascending order.
    pub fn available() -> Vec<Width> {
        [Width::Baseline, Width::Avx2, Width::Avx512]
            .into_iter()
            .filter(|width| width.is_available())
            .collect()
    }

    /// The greatest width that this processor supports.
    pub fn widest() -> Width {
        if Width::Avx512.is_available() {
            Width::Avx512
        } else if Width::Avx2.is_available() {
            Width::Avx2
        } else {
            Width::Baseline
        }
    }

    fn is_available(self) -> bool {
        #[cfg(target_arch = "x86_64")]
        match self {
            Width::Baseline => true,
            Width::Avx2 => std::arch::is_x86_feature_detected!("avx2"),
            Width::Avx512 => {
                std::arch::is_x86_feature_detected!("avx512f")
                    && std::arch::is_x86_feature_detected!("avx512bw")
                    && std::arch::is_x86_feature_detected!("avx512dq")
                    && std::arch::is_x86_feature_detected!("avx512vl")
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        matches!(self, Width::Baseline)
    }

    /// Runs a kernel with these instructions, or with the baseline where the processor does not support them.
    #[allow(unsafe_code, reason = "calls code that is compiled for instructions found at run time")]
    pub(crate) fn run(self, kernel: impl Kernel) {
        #[cfg(target_arch = "x86_64")]
        match self {
            // SAFETY: `is_available` has just found every feature that `with_avx512` enables.
            Width::Avx512 if self.is_available() => return unsafe { with_avx512(kernel) },
            // SAFETY: `is_available` has just found the feature that `with_avx2` enables.
            Width::Avx2 if self.is_available() => return unsafe { with_avx2(kernel) },
            _ => {}
        }
        kernel.run();
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn with_avx2(kernel: impl Kernel) {
    kernel.run();
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,avx512f,avx512bw,avx512dq,avx512vl")]
fn with_avx512(kernel: impl Kernel) {
    kernel.run();
}
