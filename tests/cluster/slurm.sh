# Debian's Slurm on this machine, without installing it: a controller and a node, as the user who runs this.
#
# Sourced by run.sh, which sets `debian` (folder of the unpacked packages) and `work`, and knows `within`.

slurmctld=
slurmd=

# Starts the node, with the folder of a machine that has just been booted.
slurm_node() {
    rm -rf "$work/daemons/spool"
    mkdir "$work/daemons/spool"
    "$debian/usr/sbin/slurmd-wlm" -D -f "$SLURM_CONF" -d "$debian/usr/sbin/slurmstepd-wlm" -N "$host" >>"$work/daemons/slurmd.log" 2>&1 &
    slurmd=$!
}

slurm_is_idle() {
    [ "$(sinfo --noheader --format=%T)" = idle ]
}

# Starts a cluster of one node. It has more cores than this machine, so that all tasks of a small array run at once; what the
# node forgets of a killed task after 5 s, and Slurm waits for, is 120 s unless stated.
slurm_start() {
    host=$(hostname -s)
    plugins=$(find "$debian/usr/lib" -type d -name slurm-wlm)
    ports=$(python3 -c 'import socket as s; a, b = s.socket(), s.socket(); a.bind(("", 0)); b.bind(("", 0)); print(a.getsockname()[1], b.getsockname()[1])')
    mkdir "$work/daemons" "$work/daemons/state"
    cat >"$work/daemons/slurm.conf" <<END
ClusterName=gerono
SlurmctldHost=$host(127.0.0.1)
SlurmUser=$(id -un)
SlurmdUser=$(id -un)
AuthType=auth/none
CredType=cred/none
AuthInfo=cred_expire=5
PluginDir=$plugins
StateSaveLocation=$work/daemons/state
SlurmdSpoolDir=$work/daemons/spool
SlurmctldPidFile=$work/daemons/slurmctld.pid
SlurmdPidFile=$work/daemons/slurmd.pid
SlurmctldPort=${ports% *}
SlurmdPort=${ports#* }
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
MpiDefault=none
ReturnToService=2
SlurmdParameters=config_overrides
CommunicationParameters=NoCtldInAddrAny,NoInAddrAny
NodeName=$host NodeAddr=127.0.0.1 CPUs=8 RealMemory=2000 State=UNKNOWN
PartitionName=all Nodes=$host Default=YES MaxTime=10 State=UP
END
    export SLURM_CONF="$work/daemons/slurm.conf"
    export LD_LIBRARY_PATH="${plugins%/*}:$plugins"
    export PATH="$debian/usr/bin:$PATH"
    "$debian/usr/sbin/slurmctld-wlm" -D -f "$SLURM_CONF" >"$work/daemons/slurmctld.log" 2>&1 &
    slurmctld=$!
    slurm_node
    within 30 slurm_is_idle
}

# Processes of the tasks that run: those of the commands, and of Slurm's own beside each.
slurm_tasks() {
    for command in $(scontrol listpids 2>/dev/null | awk 'NR > 1 { print $1 }'); do
        echo "$command"
        awk '{ print $4 }' "/proc/$command/stat"
    done
}

# The node's power fails; the controller is told, as by an administrator or by its own timeout; then it boots again.
slurm_power_failure() {
    # shellcheck disable=SC2046 # words are wanted
    kill -KILL "$slurmd" $(slurm_tasks)
    wait "$slurmd" 2>/dev/null || true
    scontrol update NodeName="$host" State=DOWN Reason=power
    slurm_node
}

# Prints what Slurm says of a job under a key such as JobState.
slurm_says() {
    scontrol show job "$1" | tr ' ' '\n' | sed -n "s/^$2=//p"
}

slurm_is() {
    [ "$(slurm_says "$1" JobState)" = "$2" ]
}

slurm_is_empty() {
    [ -z "$(squeue --noheader)" ]
}

slurm_stop() {
    if [ -n "$slurmctld" ]; then
        scancel --user="$(id -un)" || true
        within 20 slurm_is_empty || true
        kill "$slurmd" "$slurmctld" 2>/dev/null || true
        wait "$slurmd" "$slurmctld" || true
    fi
    slurmctld=
}
