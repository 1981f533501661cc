//! The drive: what stands between the controller's number and the volts on the actuator.

/// Converter and amplifier. Part by part in the order of the signal: quantisation, delay, saturation.
#[derive(Clone, Debug, PartialEq)]
pub struct Drive {
    /// Lowest and highest output in volts; infinite for none.
    pub range_v: [f64; 2],
    /// Pure delay in seconds, >= 0.
    pub delay_s: f64,
    /// Step of the converter in volts; zero for none.
    pub quantum_v: f64,
}

impl Drive {
    /// A drive that does nothing.
    pub const IDEAL: Drive = Drive { range_v: [f64::NEG_INFINITY, f64::INFINITY], delay_s: 0.0, quantum_v: 0.0 };

    /// Volts at the actuator for a command that has passed the delay.
    #[inline]
    pub fn output_v(&self, command_v: f64) -> f64 {
        let converted_v =
            if self.quantum_v > 0.0 { (command_v / self.quantum_v).round() * self.quantum_v } else { command_v };
        converted_v.clamp(self.range_v[0], self.range_v[1])
    }
}
