//! Orders of clients: parameters and services. The source of the session decides about them, as about those of a window.

use crate::metrics::speed_factor;
use crate::protocol::{JSON, Parameter};
use city3d_network::listener::{PeerCounters, count};
use city3d_session::{Order, OrderSender, PublishedState, RunPhase, RunState, Speed};
use serde_json::{Value, json};
use std::sync::{Arc, OnceLock};
use std::time::Duration;
use tokio::time::{Instant, sleep};

/// A city that has not answered by then says nothing.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(2);
/// Interval at which its state is looked at meanwhile.
const LOOK: Duration = Duration::from_millis(5);

const SCENARIO: &str = "/city3d/scenario";
const STATE: &str = "/city3d/state";
const SPEED: &str = "/city3d/speed";
/// The parameters of a city.
pub(crate) const PARAMETERS: [&str; 3] = [SCENARIO, STATE, SPEED];

/// What a client of the right token may call, by number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Service {
    Start = 1,
    Pause,
    Step,
    Reset,
    SetSpeed,
}

impl Service {
    pub(crate) const ALL: [Self; 5] = [Self::Start, Self::Pause, Self::Step, Self::Reset, Self::SetSpeed];

    pub(crate) fn of(number: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|service| *service as u32 == number)
    }

    fn name(self) -> &'static str {
        match self {
            Self::Start => "/city3d/start",
            Self::Pause => "/city3d/pause",
            Self::Step => "/city3d/step",
            Self::Reset => "/city3d/reset",
            Self::SetSpeed => "/city3d/set_speed",
        }
    }

    /// As the protocol advertises it.
    pub(crate) fn advertisement(self) -> Value {
        let request = match self {
            Self::SetSpeed => json!({ "title": "city3d.SetSpeed", "type": "object", "required": ["factor"],
                "properties": { "factor": { "type": "number", "description": "multiple of real time" } } }),
            _ => json!({ "title": "city3d.Nothing", "type": "object", "properties": {} }),
        };
        let response = json!({ "title": "city3d.Answer", "type": "object",
            "properties": { "success": { "type": "boolean" }, "message": { "type": "string" } } });
        let schema = |schema: Value| {
            json!({ "encoding": JSON, "schemaName": schema["title"], "schemaEncoding": "jsonschema",
                "schema": schema.to_string() })
        };
        json!({ "id": self as u32, "name": self.name(), "type": request["title"].clone(),
            "request": schema(request), "response": schema(response) })
    }

    /// The order that a call asks for.
    ///
    /// # Errors
    /// What is wrong with the request.
    pub(crate) fn order(self, request: &[u8]) -> Result<Order, String> {
        Ok(match self {
            Self::Start => Order::Start,
            Self::Pause => Order::Pause,
            Self::Step => Order::Step,
            Self::Reset => Order::Reset,
            Self::SetSpeed => {
                let request: Value =
                    serde_json::from_slice(request).map_err(|error| format!("no JSON: {error}"))?;
                speed_order(&request["factor"])?
            }
        })
    }
}

fn speed_order(factor: &Value) -> Result<Order, String> {
    let factor = factor.as_f64().filter(|factor| factor.is_finite() && *factor > 0.0);
    let factor = factor.ok_or("the speed has to be a number above 0, a multiple of real time")?;
    Ok(Order::Speed(Speed::times(factor)))
}

/// The order that a new value of a parameter asks for.
///
/// # Errors
/// Why there is none.
pub(crate) fn parameter_order(parameter: &Parameter) -> Result<Order, String> {
    let value = parameter.value.clone().unwrap_or_default();
    match (parameter.name.as_str(), value.as_str()) {
        (SPEED, _) => speed_order(&value),
        (STATE, Some("running")) => Ok(Order::Start),
        (STATE, Some("paused")) => Ok(Order::Pause),
        (STATE, Some("ready")) => Ok(Order::Reset),
        (STATE, _) => Err(format!("{STATE} can be set to running, paused or ready")),
        (SCENARIO, _) => Err("the scenario of a city that runs does not change".to_owned()),
        (name, _) => Err(format!("there is no parameter {name}")),
    }
}

/// Gives orders to the session, and hears what becomes of them.
#[derive(Debug)]
pub(crate) struct Control {
    orders: OrderSender,
    state: Arc<OnceLock<PublishedState>>,
    scenario: String,
    counters: Arc<PeerCounters>,
}

impl Control {
    pub(crate) fn new(
        orders: OrderSender,
        state: Arc<OnceLock<PublishedState>>,
        scenario: &str,
        counters: Arc<PeerCounters>,
    ) -> Self {
        Self { orders, state, scenario: scenario.to_owned(), counters }
    }

    /// The name of the scenario.
    pub(crate) fn scenario(&self) -> &str {
        &self.scenario
    }

    /// The latest state; `None` before the session has begun.
    pub(crate) fn state(&self) -> Option<Arc<RunState>> {
        self.state.get().map(PublishedState::run_state)
    }

    /// The parameters with their values, by name.
    pub(crate) fn parameters(&self) -> Vec<(&'static str, Value)> {
        let state = self.state();
        let (phase, speed) = state.map_or_else(
            || (RunPhase::Ready.label().to_owned(), 1.0),
            |state| (state.phase.label().to_owned(), speed_factor(state.speed)),
        );
        vec![
            (SCENARIO, json!({ "name": SCENARIO, "value": self.scenario })),
            (STATE, json!({ "name": STATE, "value": phase })),
            (SPEED, json!({ "name": SPEED, "value": speed, "type": "float64" })),
        ]
    }

    /// Gives an order, and waits until it is carried out.
    ///
    /// # Errors
    /// Why it is not.
    pub(crate) async fn carry_out(&self, order: Order) -> Result<(), String> {
        let Some(before) = self.state() else { return Err("the city has not begun yet".to_owned()) };
        let refusals = |state: &RunState| state.refusal.as_ref().map_or(0, |(count, _)| *count);
        if !self.orders.send(order.clone()) {
            count(&self.counters.lost_orders, 1);
            return Err("the city takes no more orders now".to_owned());
        }
        let until = Instant::now() + ANSWER_TIMEOUT;
        while Instant::now() < until {
            sleep(LOOK).await;
            let Some(now) = self.state() else { break };
            if refusals(&now) > refusals(&before)
                && let Some((_, why)) = &now.refusal
            {
                return Err(why.to_string());
            }
            if is_done(&order, &before, &now) {
                return Ok(());
            }
            if now.has_ended {
                return Err("the city has ended".to_owned());
            }
        }
        Err("the city has not carried it out yet".to_owned())
    }
}

/// Whether a state shows that an order has been carried out.
fn is_done(order: &Order, before: &RunState, now: &RunState) -> bool {
    match order {
        Order::Start => now.phase == RunPhase::Running,
        Order::Pause => now.phase != RunPhase::Running,
        Order::Reset => now.run != before.run || now.phase == RunPhase::Ready,
        Order::Step => now.now.tick != before.now.tick,
        Order::Speed(speed) => now.speed == *speed,
        _ => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_order_is_refused_with_the_reason() {
        let set = |name: &str, value: Value| {
            parameter_order(&Parameter { name: name.to_owned(), value: Some(value) })
        };
        assert_eq!(set(SPEED, json!(2)), Ok(Order::Speed(Speed::Times(2.0))));
        assert_eq!(set(SPEED, json!(1e9)), Ok(Order::Speed(Speed::Times(Speed::FASTEST))));
        assert_eq!(set(STATE, json!("ready")), Ok(Order::Reset));
        for (name, value) in [
            (SPEED, json!("fast")),
            (SPEED, json!(-1)),
            (STATE, json!("over")),
            (SCENARIO, json!("x")),
            ("/x", json!(1)),
        ] {
            assert!(set(name, value.clone()).is_err(), "{name} {value}");
        }
        assert_eq!(Service::SetSpeed.order(br#"{"factor":0.5}"#), Ok(Order::Speed(Speed::Times(0.5))));
        assert!(Service::SetSpeed.order(b"{").is_err() && Service::SetSpeed.order(b"{}").is_err());
        assert_eq!(Service::of(4).map(|service| service.order(b"")), Some(Ok(Order::Reset)));
        assert_eq!((Service::of(0), Service::of(6)), (None, None));
    }
}
