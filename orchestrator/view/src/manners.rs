//! Low impact on a flight: the view has the lowest priority, and stays off the services' cores.

use runtime::deployment;

/// Gives this thread, and those that it will start, idle priority. A refusal is ignored: it costs the flight little.
pub fn use_idle_priority() {
    let _ = deployment::use_idle();
}

/// Affinity of this process: keeps it off the cores of a flight's services.
#[derive(Debug)]
pub struct Distance {
    /// Cores that this process may use.
    given: Vec<usize>,
    /// Cores that it uses.
    used: Vec<usize>,
}

impl Distance {
    /// Starts with all permitted cores.
    #[must_use]
    pub fn none() -> Self {
        let given = deployment::allowed_cores();
        Self {
            used: given.clone(),
            given,
        }
    }

    /// Leaves the cores that these processes are pinned to, if others are permitted.
    pub fn avoid_cores_of(&mut self, processes: impl Iterator<Item = u32>) {
        let taken: Vec<_> = processes.filter_map(deployment::cores_of).collect();
        let free = free_of(&self.given, &taken);
        // A refusal is ignored: it only costs the flight time.
        if free != self.used && deployment::pin_all_threads_to(&free).is_ok() {
            self.used = free;
        }
    }
}

/// Returns the permitted cores without pinned services; all of them if none is free.
fn free_of(given: &[usize], taken: &[Vec<usize>]) -> Vec<usize> {
    // A process that may run on all permitted cores is not pinned.
    let is_bound = |cores: &&Vec<usize>| given.iter().any(|core| !cores.contains(core));
    let bound: Vec<_> = taken.iter().filter(is_bound).flatten().collect();
    let free: Vec<_> = given
        .iter()
        .copied()
        .filter(|core| !bound.contains(&core))
        .collect();
    if free.is_empty() { given.to_vec() } else { free }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_core_of_the_services_is_left_to_them() {
        assert_eq!(free_of(&[0, 1, 2, 3], &[vec![2], vec![2], vec![3]]), [0, 1]);
    }

    #[test]
    fn services_that_may_run_anywhere_take_no_core_and_those_on_all_cores_leave_none() {
        assert_eq!(free_of(&[0, 1], &[vec![0, 1], vec![0, 1, 2]]), [0, 1]);
        assert_eq!(free_of(&[0, 1], &[vec![0], vec![1]]), [0, 1]);
        assert_eq!(free_of(&[0], &[vec![0]]), [0]);
    }
}
