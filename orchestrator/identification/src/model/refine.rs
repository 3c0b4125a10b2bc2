//! Marker offset, delay and lags by the prediction-error method, with empirical intervals.
//!
//! The whitened innovations of the captures are a function of the filter settings. Gauss–Newton minimises the sum of their
//! squares, and the process noise is chosen by maximum likelihood. The mass is estimated as well, for every block of some
//! seconds: it may change in flight, and a wrong mass resembles an offset, because both scale the acceleration by tilt.
//!
//! Offset and delay are estimated with the model's lags first, and then all of them together ([`Refined::answer`]).
//!
//! Intervals are based on the sandwich estimate of the covariance, from sums of the gradient over one second each. They hold with
//! turbulence, a quantised link and wrong noise parameters of the filter, where the curvature alone is too optimistic.

use std::collections::VecDeque;

use flight::many;
use metrics::{CERTAIN, CONFIDENCE};
use nalgebra::{SMatrix, SVector};
use statistics::{quantile, student};

use super::IdentifyError;
use super::answer::Answer;
use super::recording::{FilterSettings, Innovation, Recording};
use super::report::Quantity;

/// Number of parameters: three components of the offset, m, the delay, the lag of the body rates and that of the thrust, s.
const PARAMETERS: usize = 6;

/// Number of parameters that are estimated with the model's lags.
const WITHOUT_LAGS: usize = 4;

/// Indices of the delay, and of the lags of body rates and thrust.
const DELAY: usize = 3;
const RATE_LAG: usize = 4;
const THRUST_LAG: usize = 5;

/// Number of parameters with the mass, kg.
const ALL: usize = PARAMETERS + 1;

/// Steps of the difference quotients.
const STEPS: [f64; ALL] = [2e-3, 2e-3, 2e-3, 1e-3, 2e-3, 2e-3, 2e-3];

/// Duration of a block with a separate mass, ns.
const BLOCK_NS: u64 = 5_000_000_000;

/// Time for which a filter runs before the captures of a block count, ns.
const WARM_UP_NS: u64 = 2_000_000_000;

/// Duration of a cluster whose innovations may be correlated, ns.
const CLUSTER_NS: u64 = 1_000_000_000;

/// Minimum degrees of freedom. Every second adds one, the parameters and the masses of the blocks take one each: twelve seconds
/// have five.
const FREEDOM: usize = 5;

/// Maximum delay, and maximum lag, s.
const LONGEST: f64 = 0.1;

/// Maximum number of Gauss–Newton steps for the lags, from the model's.
const LAG_STEPS: usize = 16;

/// Step of delay and lags, as a share of their standard errors, at which they have converged.
const CONVERGED: f64 = 0.05;

/// Minimum systematic error, as half-widths, m and s: the disturbance is not exactly a random walk.
const SYSTEMATIC: [f64; PARAMETERS] = [1.5e-3, 1.5e-3, 1.5e-3, 3e-4, 3e-4, 3e-4];

/// Factor on [`SYSTEMATIC`] for the confidence [`CERTAIN`]: the ratio of both half-widths of a normal error.
const SYSTEMATIC_CERTAIN: f64 = 1.7;

/// Factors on the stated noise of the body rates and on the stated drift of the disturbance, with the index of the start value.
const RATE_FACTORS: (&[f64], usize) = (&[1.0, 0.1, 0.01, 0.001], 0);
const DRIFT_FACTORS: (&[f64], usize) = (&[3.0, 1.0, 0.3, 0.1, 0.03, 0.01, 0.003, 0.001], 3);

/// Minimum half-width of an interval, as a share of the half-range of the estimates with the neighbouring drifts: the likeliest
/// drift is known to a factor of 1.5, and the neighbours are a factor of 3 apart.
const OF_NEIGHBOURS: f64 = 0.37;

/// Maximum ratio of a block's mean square to the median of all blocks; blocks above it are outliers: the mass changed, or the
/// vehicle was touched.
const OUTLIER: f64 = 2.0;

type Row = SMatrix<f64, 6, ALL>;

/// A block of the flight with its mass.
#[derive(Clone, Copy, Debug)]
struct Block {
    from_ns: u64,
    to_ns: u64,
    mass: f64,
}

/// Normal equations of a block for the parameters, with the mass eliminated.
struct NormalEquations {
    /// JᵀJ.
    information: SMatrix<f64, PARAMETERS, PARAMETERS>,
    /// Jᵀr of every cluster.
    gradients: Vec<SVector<f64, PARAMETERS>>,
    /// Change of the mass: per change of the parameters, and independent of it.
    mass: (SMatrix<f64, 1, PARAMETERS>, f64),
    /// `None` without a used capture.
    mean_square: Option<f64>,
}

/// Parameters of the filter with the half-widths of their intervals, m and s.
pub struct Refined {
    found: [f64; PARAMETERS],
    errors: [f64; PARAMETERS],
    certain: [f64; PARAMETERS],
    /// Estimate with free lags, from the same settings; `None` if the flight is too short for it.
    with_lags: Option<Estimate>,
    /// Parameters of estimates with free lags and the neighbouring drifts.
    beside: Vec<SVector<f64, PARAMETERS>>,
}

/// Parameters with their standard errors, the degrees of freedom, and the masses of the blocks.
#[derive(Clone)]
struct Estimate {
    parameters: SVector<f64, PARAMETERS>,
    covariance: SMatrix<f64, PARAMETERS, PARAMETERS>,
    freedom: usize,
    blocks: Vec<Block>,
    /// `true` if the lags are estimated as well.
    has_lags: bool,
}

/// An estimate with a factor on a stated process noise.
#[derive(Clone)]
struct Tried {
    factor: f64,
    estimate: Estimate,
    /// Deviance of every block; `None` for an outlier.
    deviances: Vec<Option<f64>>,
}

/// Returns marker offset and delay, from settings that are near them.
///
/// The noise of the body rates and the drift of the disturbance are chosen by maximum likelihood. Too large values make the
/// filter attribute measurement noise to disturbances. The controller acts on that noise, which correlates the commands with it
/// and biases the mass down and the offset along the thrust: by −1, −4, −6 and −9 mm with 2, 6, 20 and 60 times the drift.
///
/// # Errors
/// [`IdentifyError`] if no filter can be made, or too few captures are usable.
pub fn refine(recording: &Recording, settings: &FilterSettings) -> Result<Refined, IdentifyError> {
    let mut estimate = Estimate::new(recording, settings);
    estimate.descend(recording, settings)?;
    let rates = |factor, _: &Estimate| {
        let tried = with_rate_noise(settings, factor);
        Tried::new(recording, &tried, factor, estimate.clone())
    };
    let (tried, likeliest) = scan(RATE_FACTORS, &estimate, rates)?;
    let settings = with_rate_noise(settings, tried[likeliest].factor);
    let drifts = |factor, from: &Estimate| {
        let (tried, mut estimate) = (with_drift(&settings, factor), from.clone());
        estimate.descend(recording, &tried)?;
        Tried::new(recording, &tried, factor, estimate)
    };
    let (tried, likeliest) = scan(DRIFT_FACTORS, &estimate, drifts)?;
    let chosen = with_drift(&settings, between(&tried, likeliest));
    let mut estimate = tried[likeliest].estimate.clone();
    estimate.descend(recording, &chosen)?;
    estimate.descend(recording, &chosen)?;
    let tried = &tried[likeliest.saturating_sub(1)..tried.len().min(likeliest + 2)];
    let neighbours: Vec<_> = tried.iter().map(|tried| tried.estimate.parameters).collect();
    let with_lags = Estimate {
        has_lags: true,
        ..estimate.clone()
    };
    let with_lags = with_lags.converged(recording, &chosen);
    let mut beside = Vec::new();
    if let Some(with_lags) = &with_lags {
        for neighbour in tried {
            let mut stepped = with_lags.clone();
            let settings = with_drift(&settings, neighbour.factor);
            if stepped.descend(recording, &settings).is_ok() {
                beside.push(stepped.parameters);
            }
        }
    }
    Ok(Refined {
        with_lags,
        beside,
        found: estimate.parameters.into(),
        errors: estimate.half_widths(&neighbours, CONFIDENCE, 1.0),
        certain: estimate.half_widths(&neighbours, CERTAIN, SYSTEMATIC_CERTAIN),
    })
}

fn with_rate_noise(settings: &FilterSettings, factor: f64) -> FilterSettings {
    let mut settings = settings.clone();
    settings.kalman.rate_noise *= factor;
    settings.kalman.rate_bias_drift *= factor;
    settings
}

fn with_drift(settings: &FilterSettings, factor: f64) -> FilterSettings {
    let mut settings = settings.clone();
    settings.kalman.disturbance_drift *= factor;
    settings
}

/// Scans factors, each from the estimate of its neighbour: down from the start value until the likelihood decreases, and up if it
/// decreases at once. Returns the attempts in the order of the factors, and the index of the likeliest.
fn scan(
    (factors, first): (&[f64], usize),
    begin: &Estimate,
    mut attempt: impl FnMut(f64, &Estimate) -> Result<Tried, IdentifyError>,
) -> Result<(Vec<Tried>, usize), IdentifyError> {
    let mut tried = VecDeque::from([attempt(factors[first], begin)?]);
    let mut likeliest = 0;
    for &factor in &factors[first + 1..] {
        tried.push_back(attempt(factor, &tried[likeliest].estimate)?);
        if tried[likeliest + 1].above(&tried[likeliest]) > 0.0 {
            break;
        }
        likeliest += 1;
    }
    for &factor in factors[..first].iter().rev() {
        if likeliest > 0 {
            break;
        }
        tried.push_front(attempt(factor, &tried[0].estimate)?);
        likeliest = usize::from(tried[0].above(&tried[1]) > 0.0);
    }
    Ok((tried.into(), likeliest))
}

/// Returns the likeliest factor by parabolic interpolation through the best and its neighbours, over the factor's logarithm.
fn between(tried: &[Tried], likeliest: usize) -> f64 {
    let best = &tried[likeliest];
    let beside = (
        likeliest.checked_sub(1).map(|index| &tried[index]),
        tried.get(likeliest + 1),
    );
    let (Some(above), Some(below)) = beside else {
        return best.factor;
    };
    let [from_above, from_below] = [above, below].map(|other| other.above(best));
    let towards_below = 0.5 * (from_above - from_below) / (from_above + from_below).max(f64::MIN_POSITIVE);
    best.factor * libm::pow(below.factor / best.factor, towards_below)
}

impl Tried {
    fn new(
        recording: &Recording,
        settings: &FilterSettings,
        factor: f64,
        estimate: Estimate,
    ) -> Result<Self, IdentifyError> {
        let deviances = estimate.deviances(recording, settings)?;
        Ok(Self {
            factor,
            estimate,
            deviances,
        })
    }

    /// Returns the excess of the deviance, −2 times the log-likelihood, over another one, in the blocks that are outliers in
    /// neither.
    fn above(&self, other: &Self) -> f64 {
        let pairs = self.deviances.iter().zip(&other.deviances);
        pairs.filter_map(|(own, other)| Some((*own)? - (*other)?)).sum()
    }
}

impl Estimate {
    fn new(recording: &Recording, settings: &FilterSettings) -> Self {
        let [begin_ns, end_ns] = recording.span_ns();
        let begins = (begin_ns.saturating_add(WARM_UP_NS)..end_ns)
            .step_by(usize::try_from(BLOCK_NS).unwrap_or(usize::MAX));
        let [x, y, z] = settings.model.marker_offset;
        Self {
            parameters: SVector::from([
                x,
                y,
                z,
                settings.model.radio_latency,
                settings.model.rate_lag,
                settings.model.thrust_lag,
            ]),
            covariance: SMatrix::zeros(),
            freedom: FREEDOM,
            has_lags: false,
            blocks: begins
                .map(|from_ns| Block {
                    from_ns,
                    to_ns: (from_ns + BLOCK_NS).min(end_ns),
                    mass: settings.model.mass,
                })
                .collect(),
        }
    }

    /// Returns the half-widths of the intervals from the random error and the systematic one, which is at least a share of the
    /// range of the estimates with the neighbouring drifts. `wider` is the ratio of the systematic half-width to that of 95 %.
    fn half_widths(
        &self,
        beside: &[SVector<f64, PARAMETERS>],
        confidence: f64,
        wider: f64,
    ) -> [f64; PARAMETERS] {
        std::array::from_fn(|index| {
            let values = beside.iter().map(|parameters| parameters[index]);
            let systematic = wider * systematic(SYSTEMATIC[index], values);
            self.half_width(self.covariance[(index, index)], systematic, confidence)
        })
    }

    /// Returns the half-width of an interval from the variance of the random error and the systematic error.
    fn half_width(&self, variance: f64, systematic: f64, confidence: f64) -> f64 {
        let by_chance = student::two_sided(confidence, self.freedom) * variance.max(0.0).sqrt();
        (by_chance * by_chance + systematic * systematic).sqrt()
    }

    /// Makes Gauss–Newton steps until delay and lags stay. Returns `None` if they do not, or stay at [`LONGEST`], which is where
    /// the search ends and no minimum.
    fn converged(mut self, recording: &Recording, settings: &FilterSettings) -> Option<Self> {
        for _ in 0..LAG_STEPS {
            let before = self.parameters;
            self.descend(recording, settings).ok()?;
            let stays = (DELAY..PARAMETERS).all(|index| {
                let change = self.parameters[index] - before[index];
                change * change <= CONVERGED * CONVERGED * self.covariance[(index, index)]
            });
            if stays {
                let is_minimum = (DELAY..PARAMETERS).all(|index| self.parameters[index] < LONGEST);
                return is_minimum.then_some(self);
            }
        }
        None
    }

    /// Makes a Gauss–Newton step.
    fn descend(&mut self, recording: &Recording, settings: &FilterSettings) -> Result<(), IdentifyError> {
        let equations = self
            .blocks
            .iter()
            .map(|block| block.equations(recording, settings, &self.parameters, self.has_lags))
            .collect::<Result<Vec<_>, _>>()?;
        let usable = usable(equations.iter().map(|equations| equations.mean_square));
        let used = || {
            let pairs = equations.iter().zip(&usable);
            pairs
                .filter(|(_, is_usable)| **is_usable)
                .map(|(equations, _)| equations)
        };
        let mut information: SMatrix<f64, PARAMETERS, PARAMETERS> =
            used().map(|equations| equations.information).sum();
        if !self.has_lags {
            // Their rows and columns are 0, and so are their gradients: they stay.
            information[(RATE_LAG, RATE_LAG)] = 1.0;
            information[(THRUST_LAG, THRUST_LAG)] = 1.0;
        }
        let gradients = || used().flat_map(|equations| &equations.gradients);
        let clusters = gradients().count();
        let parameters = if self.has_lags { PARAMETERS } else { WITHOUT_LAGS };
        self.freedom = clusters.saturating_sub(parameters + used().count());
        let Some(inverse) = information.try_inverse().filter(|_| self.freedom >= FREEDOM) else {
            return Err(IdentifyError::TooFewSeconds { counted: clusters });
        };
        let gradient: SVector<f64, PARAMETERS> = gradients().sum();
        let change = bounded_step(&information, &gradient, &self.parameters);
        let spread: SMatrix<f64, PARAMETERS, PARAMETERS> = gradients().map(|one| one * one.transpose()).sum();
        self.covariance = inverse * spread * inverse * (clusters as f64 / self.freedom as f64);
        self.parameters += change;
        for (block, equations) in self.blocks.iter_mut().zip(&equations) {
            let (by_parameters, own) = &equations.mass;
            let change = (by_parameters * change)[0] + own;
            block.mass = (block.mass + change).clamp(0.5 * block.mass, 2.0 * block.mass);
        }
        Ok(())
    }

    /// Returns the deviance of every block; `None` for an outlier.
    fn deviances(
        &self,
        recording: &Recording,
        settings: &FilterSettings,
    ) -> Result<Vec<Option<f64>>, IdentifyError> {
        let runs = many::map(&self.blocks, many::cores(), |block| {
            let run = block.innovations(recording, settings, &self.parameters, None)?;
            let counting = run.iter().filter(|(at_ns, _)| *at_ns >= block.from_ns);
            Ok(Deviance::new(
                counting.map(|(_, innovation)| *innovation),
                settings.kalman.gate,
            ))
        });
        let found = runs.into_iter().collect::<Result<Vec<_>, IdentifyError>>()?;
        let usable = usable(found.iter().map(|deviance| deviance.mean_square));
        let pairs = found.iter().zip(usable);
        Ok(pairs
            .map(|(deviance, is_usable)| is_usable.then_some(deviance.sum))
            .collect())
    }
}

/// Returns the Gauss–Newton step within the bounds of delay and lags. A parameter that would leave them goes to its bound, and
/// the step of the others is the best one with it there: to cut it off alone would leave the others at their values for a delay
/// or a lag that is not possible.
fn bounded_step(
    information: &SMatrix<f64, PARAMETERS, PARAMETERS>,
    gradient: &SVector<f64, PARAMETERS>,
    parameters: &SVector<f64, PARAMETERS>,
) -> SVector<f64, PARAMETERS> {
    let mut held: [Option<f64>; PARAMETERS] = [None; PARAMETERS];
    loop {
        let (mut matrix, mut right) = (*information, -gradient);
        for (index, change) in held.iter().enumerate() {
            let Some(change) = change else { continue };
            right -= matrix.column(index) * *change;
            matrix.row_mut(index).fill(0.0);
            matrix.column_mut(index).fill(0.0);
            matrix[(index, index)] = 1.0;
            right[index] = *change;
        }
        let change = matrix
            .try_inverse()
            .map_or_else(SVector::zeros, |inverse| inverse * right);
        let beyond = (DELAY..PARAMETERS)
            .filter(|&index| held[index].is_none())
            .find(|&index| !(0.0..=LONGEST).contains(&(parameters[index] + change[index])));
        let Some(index) = beyond else { return change };
        held[index] = Some((parameters[index] + change[index]).clamp(0.0, LONGEST) - parameters[index]);
    }
}

/// Returns the systematic error of a value: a least one, or a share of the range of its estimates with the neighbouring drifts.
fn systematic(least: f64, beside: impl Iterator<Item = f64>) -> f64 {
    let [low, high] = beside.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| {
        [low.min(value), high.max(value)]
    });
    least.max(OF_NEIGHBOURS * 0.5 * (high - low))
}

/// Misfit of the captures of a block.
struct Deviance {
    /// −2 times the log-likelihood, up to a constant.
    sum: f64,
    /// `None` without a capture.
    mean_square: Option<f64>,
}

impl Deviance {
    /// Sums the misfit. A refused capture counts with the filter's gate.
    fn new(innovations: impl Iterator<Item = Option<Innovation>>, gate: f64) -> Self {
        let (mut squares, mut determinants, mut used, mut all) = (0.0, 0.0, 0.0, 0.0);
        for innovation in innovations {
            all += 1.0;
            squares += innovation.map_or(gate, |innovation| innovation.whitened.norm_squared());
            if let Some(innovation) = innovation {
                determinants += innovation.log_determinant;
                used += 1.0;
            }
        }
        Self {
            sum: squares + determinants * all / f64::max(used, 1.0),
            mean_square: (all > 0.0).then(|| squares / all),
        }
    }
}

/// Returns for each block whether it has captures and is no outlier.
fn usable(mean_squares: impl Iterator<Item = Option<f64>> + Clone) -> Vec<bool> {
    let median = quantile::median_of(mean_squares.clone().flatten()).unwrap_or(f64::NAN);
    let is_usable = |size: f64| size <= OUTLIER * median;
    mean_squares.map(|size| size.is_some_and(is_usable)).collect()
}

impl Block {
    /// Returns the innovations of the block with these parameters, with one of them optionally changed by a step.
    fn innovations(
        &self,
        recording: &Recording,
        settings: &FilterSettings,
        parameters: &SVector<f64, PARAMETERS>,
        step: Option<(usize, f64)>,
    ) -> Result<Vec<(u64, Option<Innovation>)>, IdentifyError> {
        let [x, y, z, latency, rate_lag, thrust_lag] = (*parameters).into();
        let mut values = [x, y, z, latency, rate_lag, thrust_lag, self.mass];
        if let Some((index, by)) = step {
            values[index] += by;
        }
        let mut settings = settings.clone();
        settings.model.marker_offset = [values[0], values[1], values[2]];
        settings.model.radio_latency = values[DELAY].max(0.0);
        settings.model.rate_lag = values[RATE_LAG].max(0.0);
        settings.model.thrust_lag = values[THRUST_LAG].max(0.0);
        settings.model.mass = values[PARAMETERS];
        settings.kalman.marker_offset_deviation = 0.0;
        let from_ns = self.from_ns.saturating_sub(WARM_UP_NS);
        recording.innovations(&settings, from_ns, self.to_ns)
    }

    fn equations(
        &self,
        recording: &Recording,
        settings: &FilterSettings,
        parameters: &SVector<f64, PARAMETERS>,
        has_lags: bool,
    ) -> Result<NormalEquations, IdentifyError> {
        let mut runs: Vec<Option<(usize, f64)>> = vec![None];
        let is_free = |index: &usize| has_lags || !(WITHOUT_LAGS..PARAMETERS).contains(index);
        let free: Vec<usize> = (0..ALL).filter(is_free).collect();
        runs.extend(
            free.iter()
                .flat_map(|&index| [STEPS[index], -STEPS[index]].map(|step| Some((index, step)))),
        );
        let runs = many::map(&runs, many::cores(), |&step| {
            self.innovations(recording, settings, parameters, step)
        });
        let runs = runs.into_iter().collect::<Result<Vec<_>, _>>()?;
        let [base, steps @ ..] = &runs[..] else {
            unreachable!("there is a first run");
        };
        let mut rows: Vec<(u64, SVector<f64, 6>, Row)> = Vec::new();
        for (index, (time_ns, innovation)) in base.iter().enumerate() {
            let whitened = |run: &Vec<(u64, Option<Innovation>)>| {
                run.get(index)
                    .and_then(|(_, innovation)| innovation.map(|found| found.whitened))
            };
            let stepped: Option<Vec<_>> = steps.iter().map(whitened).collect();
            if *time_ns < self.from_ns {
                continue;
            }
            if let (Some(innovation), Some(stepped)) = (innovation, stepped) {
                let mut row = Row::zeros();
                for (pair, &index) in free.iter().enumerate() {
                    // Delay and lags cannot become negative: their lower step may be shorter.
                    let lower = if (DELAY..PARAMETERS).contains(&index) {
                        STEPS[index].min(parameters[index])
                    } else {
                        STEPS[index]
                    };
                    let difference: SVector<f64, 6> = stepped[2 * pair] - stepped[2 * pair + 1];
                    row.set_column(index, &(difference / (STEPS[index] + lower)));
                }
                rows.push((*time_ns, innovation.whitened, row));
            }
        }
        Ok(NormalEquations::new(&rows, self.from_ns))
    }
}

impl NormalEquations {
    fn new(rows: &[(u64, SVector<f64, 6>, Row)], from_ns: u64) -> Self {
        let information: SMatrix<f64, ALL, ALL> = rows.iter().map(|(_, _, row)| row.transpose() * row).sum();
        let gradient: SVector<f64, ALL> = rows
            .iter()
            .map(|(_, residual, row)| row.transpose() * residual)
            .sum();
        let mass_information = information[(PARAMETERS, PARAMETERS)].max(f64::MIN_POSITIVE);
        let cross = information.fixed_view::<1, PARAMETERS>(PARAMETERS, 0) / mass_information;
        let mut equations = Self {
            information: information.fixed_view::<PARAMETERS, PARAMETERS>(0, 0)
                - information.fixed_view::<PARAMETERS, 1>(0, PARAMETERS) * cross,
            gradients: Vec::new(),
            mass: (-cross, -gradient[PARAMETERS] / mass_information),
            mean_square: (!rows.is_empty()).then(|| {
                let squares = rows.iter().map(|(_, residual, _)| residual.norm_squared());
                squares.sum::<f64>() / rows.len() as f64
            }),
        };
        let cluster_of = |time_ns: u64| (time_ns - from_ns) / CLUSTER_NS;
        for cluster in rows.chunk_by(|(one, ..), (other, ..)| cluster_of(*one) == cluster_of(*other)) {
            let sum: SVector<f64, ALL> = cluster
                .iter()
                .map(|(_, residual, row)| row.transpose() * residual)
                .sum();
            equations
                .gradients
                .push(sum.fixed_rows::<PARAMETERS>(0) - cross.transpose() * sum[PARAMETERS]);
        }
        equations
    }
}

/// Returns the offset and the delay beside the stated values.
#[must_use]
pub fn beside(stated: &FilterSettings, refined: &Refined) -> ([Quantity; 3], Quantity) {
    let quantity = |index: usize, stated: f64| Quantity {
        stated,
        found: refined.found[index],
        error: refined.errors[index],
        certain: refined.certain[index],
    };
    let offset = [0, 1, 2].map(|axis| quantity(axis, stated.model.marker_offset[axis]));
    (offset, quantity(DELAY, stated.model.radio_latency))
}

impl Refined {
    /// Returns the delay, the lags and their sums beside the stated values; `None` if the flight is too short for them.
    #[must_use]
    pub fn answer(&self, recording: &Recording, stated: &FilterSettings) -> Option<Answer> {
        let estimate = self.with_lags.as_ref()?;
        let model = &stated.model;
        let stated = [model.radio_latency, model.rate_lag, model.thrust_lag];
        // The sum of the parameters that are selected.
        let sum = |selected: &[usize]| {
            let mut weights = SVector::<f64, PARAMETERS>::zeros();
            for &index in selected {
                weights[index] = 1.0;
            }
            let variance = (weights.transpose() * estimate.covariance * weights)[0];
            let beside = self.beside.iter().map(|parameters| weights.dot(parameters));
            let systematic = systematic(SYSTEMATIC[DELAY], beside);
            let half_width =
                |confidence, wider: f64| estimate.half_width(variance, wider * systematic, confidence);
            Quantity {
                stated: selected.iter().map(|&index| stated[index - DELAY]).sum(),
                found: weights.dot(&estimate.parameters),
                error: half_width(CONFIDENCE, 1.0),
                certain: half_width(CERTAIN, SYSTEMATIC_CERTAIN),
            }
        };
        Some(Answer {
            radio_latency: sum(&[DELAY]),
            rate_lag: sum(&[RATE_LAG]),
            thrust_lag: sum(&[THRUST_LAG]),
            to_rate: sum(&[DELAY, RATE_LAG]),
            to_thrust: sum(&[DELAY, THRUST_LAG]),
            capture_age: recording.capture_age(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_to_a_bound_is_the_best_one_with_the_parameter_there() {
        let mut information = SMatrix::identity();
        // Delay and rate lag have nearly the same effect.
        information[(DELAY, RATE_LAG)] = 0.9;
        information[(RATE_LAG, DELAY)] = 0.9;
        let mut parameters = SVector::zeros();
        parameters[RATE_LAG] = 0.01;
        parameters[THRUST_LAG] = 0.09;
        // The minimum is at a delay of 8 ms with a lag of −3 ms, and at a thrust lag of 120 ms.
        let wanted = SVector::from([0.0, 0.0, 0.0, 0.008, -0.013, 0.03]);
        let gradient = -(information * wanted);
        let change = bounded_step(&information, &gradient, &parameters);
        // With no lag the sum of squares is smallest at 8 − 0.9 · 3 ms.
        let best = SVector::from([0.0, 0.0, 0.0, 0.0053, -0.01, 0.01]);
        assert!((change - best).amax() < 1e-12, "{change}");
        parameters[RATE_LAG] = 0.05;
        parameters[THRUST_LAG] = 0.01;
        let change = bounded_step(&information, &gradient, &parameters);
        assert!((change - wanted).amax() < 1e-12, "within the bounds: {change}");
    }

    #[test]
    fn estimates_that_depend_on_the_drift_widen_an_interval() {
        assert_eq!(systematic(3e-4, [0.02].into_iter()), 3e-4);
        assert_eq!(systematic(3e-4, std::iter::empty()), 3e-4);
        let wide = systematic(3e-4, [0.02, 0.03, 0.025].into_iter());
        assert!((wide - 0.00185).abs() < 1e-12, "{wide}");
    }

    #[test]
    fn a_block_without_captures_is_not_usable_and_does_not_lower_the_median() {
        let empty = NormalEquations::new(&[], 0);
        assert!(empty.mean_square.is_none());
        assert!(Deviance::new(std::iter::empty(), 25.0).mean_square.is_none());
        let squares = [Some(6.0), None, None, None, Some(7.0), Some(20.0)];
        assert_eq!(
            usable(squares.into_iter()),
            [true, false, false, false, true, false]
        );
        assert_eq!(usable([None, None].into_iter()), [false, false]);
    }
}
