#!/usr/bin/env bash
# One command from body model to report; see README.md.
#   ./reproduce.sh [--profile smoke|demo|paper] [--run NAME] [--seed N] [--aligner sgd|robust|both]
#                  [--seeds N]      (N trainings of the predictors from seeds that follow: 3 in `paper`, else 1)
#                  [--preset literal|literal_per_coordinate]    (the paper's words alone: run <profile>_<preset>)
#                  [--gender female|male]              (of the synthetic people; men: run <profile>_male)
#                  [--leave-out SEQUENCE ...]                  (of the registered meshes: not aligned)
#                  [--engine ray [--address HOST:PORT]]       (on a cluster: docs/scaling.md)
#                  [--smpl FILE --dyna FILE.h5 ... [--amass DIR [--amass-list FILE] [--amass-fps N]]
#                   [--dmpl FILE]]                          (licensed: docs/data.md)
#   ./reproduce.sh setup                the environment alone, for runs and tests
#   ./reproduce.sh test                 the environment, then linters, types and tests
#   ./reproduce.sh test --slow          the same with the tests that take up to minutes each
#   ./reproduce.sh test PYTEST_OPTIONS  linters, types and one pytest with these options
set -euo pipefail
caller=$PWD
cd "$(dirname "${BASH_SOURCE[0]}")"

find_python() {
    for candidate in "${PYTHON:-}" python3 python3.12 python3.11 python3.13 python3.10; do
        if [[ -n $candidate ]] && "$candidate" -c \
            'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null; then
            echo "$candidate"
            return
        fi
    done
    echo "reproduce.sh: no Python found; expected 3.10 to 3.13. Install one or set PYTHON=/path/to/python3." >&2
    exit 2
}

# Where there is no NVIDIA GPU, builds without CUDA.
nvidia-smi -L >/dev/null 2>&1 && train=train || train=train-cpu
# What a run on this machine needs; a cluster, tests and pages need half a minute and 0.8 GB more.
for_runs=$train,usd,clip
for_everything=$for_runs,abc,fbx,ray,dev,docs

setup() {
    local extras=$1 stamp=.venv/installed enough module
    for enough in "$extras" "$for_everything"; do
        [[ -f $stamp ]] && cmp -s "$stamp" <(print_stamp "$enough") && return
    done
    echo "setting up .venv (once)" >&2
    [[ -x .venv/bin/python ]] || "$(find_python)" -m venv .venv
    # Both builds of TensorFlow write the same files, and pip keeps the PyTorch that it finds.
    [[ ! -f $stamp || $(<"$stamp") == "$train",* ]] ||
        .venv/bin/python -m pip uninstall -qq --yes tensorflow tensorflow-cpu torch
    # PyTorch's own index has a wheel without CUDA; where neither it nor the wheel is found, PyPI's.
    [[ $train == train ]] || install torch --no-deps --only-binary :all: --retries 0 --timeout 10 \
        --index-url https://download.pytorch.org/whl/cpu >/dev/null 2>&1 || true
    install --editable ".[$extras]"
    # What only builds and tests C++ against the frameworks: 0.4 GB.
    rm -rf .venv/lib/python*/site-packages/{tensorflow/include,torch/include,torch/test}
    # Most modules are never imported; those that are, are compiled here or by whoever is first.
    for module in torch_align_ae.alignment.stage_align tf_dsnet.train_networks tf_dsnet.train_plus \
        dsnet.report.stage_report torch._inductor tyro; do
        PYTHONDONTWRITEBYTECODE="" .venv/bin/python -c "import $module"
    done
    # Written last, so that an interrupted installation is done again.
    print_stamp "$extras" >"$stamp"
}

install() {
    .venv/bin/python -m pip install --quiet --disable-pip-version-check --no-compile \
        --constraint constraints.txt "$@"
}

print_stamp() {
    echo "$1"
    cat pyproject.toml constraints.txt
}

run_tests() {
    .venv/bin/ruff check .
    .venv/bin/ruff format --check .
    .venv/bin/pyright
    case ${1-} in
        "") run_all_tests ;;
        --slow) run_all_tests -m "not (browser or cluster or faults or fuzz)" ;;
        *) .venv/bin/python -m pytest "$@" ;;
    esac
}

run_all_tests() {
    # PyTorch and TensorFlow in one process have crashed by order of import: each has its own, as stages do.
    # Long folders stand early in the alphabet: in their own order processes end together.
    local processes=(--numprocesses auto --maxprocesses 4 --no-loadscope-reorder)
    # Each computes on one core: threads of several processes would wait for one another.
    export OMP_NUM_THREADS=${OMP_NUM_THREADS:-1}
    .venv/bin/python -m pytest "${processes[@]}" --durations=6 tests/tf_dsnet "$@"
    .venv/bin/python -m pytest "${processes[@]}" --durations=12 --ignore tests/tf_dsnet "$@"
}

refuse() {
    echo "reproduce.sh: $*" >&2
    exit 2
}

# Paths are the caller's, whose folder need not be this one; a slip is told before hours of work.
existing() {
    local path=$1
    [[ $path == /* ]] || path=$caller/$path
    [[ -e $path ]] || refuse "$path does not exist. Check the path."
    echo "$path"
}

run_stages() {
    local profile=demo run="" seed=0 seeds="" gender="" corpus=() align=() dyna=() infer=() licensed="" path
    local aligner="" preset="" engine=() train_ae=() train=()
    while (($#)); do
        case $1 in
            --profile | --run | --seed | --seeds | --preset | --gender | --aligner | --smpl | --dyna | --amass | --amass-list | --amass-fps | --dmpl | --leave-out | --engine | --address) ;;
            *) refuse "unknown option $1; see ./reproduce.sh --help." ;;
        esac
        [[ -n ${2-} ]] || refuse "$1 needs a value."
        case $1 in
            --profile) profile=$2 ;;
            --run) run=$2 ;;
            --seed) seed=$2 ;;
            --seeds)
                [[ $2 =~ ^[1-9]$ ]] || refuse "--seeds $2; expected 1 to 9."
                seeds=$2
                ;;
            --engine | --address) engine+=("$1" "$2") ;;
            --preset)
                [[ $2 == literal || $2 == literal_per_coordinate ]] ||
                    refuse "--preset $2; expected literal or literal_per_coordinate."
                preset=$2
                ;;
            --gender)
                [[ $2 == female || $2 == male ]] || refuse "--gender $2; expected female or male."
                gender=$2
                corpus=(--gender "$2")
                ;;
            --aligner)
                [[ $2 == sgd || $2 == robust || $2 == both ]] ||
                    refuse "--aligner $2; expected sgd, robust or both."
                align+=(--aligner "$2") aligner=$2
                ;;
            --smpl)
                path=$(existing "$2")
                align+=(--smpl "$path") licensed=yes
                ;;
            --dyna)
                licensed=yes
                while [[ -n ${2-} && $2 != --* ]]; do
                    path=$(existing "$2")
                    dyna+=("$path")
                    shift
                done
                shift && continue
                ;;
            --leave-out)
                align+=(--leave-out)
                while [[ -n ${2-} && $2 != --* ]]; do
                    align+=("$2")
                    shift
                done
                shift && continue
                ;;
            --amass | --amass-list)
                path=$(existing "$2")
                infer+=("$1" "$path")
                ;;
            --amass-fps) infer+=(--amass-fps "$2") ;;
            --dmpl)
                path=$(existing "$2")
                train_ae=(--dmpl "$path")
                train=(
                    --predictors dsnet_standardised dsnet_faithful dsnet_literal
                    dsnet_literal_per_coordinate dyna_like dyna_like_dmpl
                )
                export DSNET_PLUGINS=benchmarks.plugin PYTHONPATH=$PWD
                ;;
        esac
        shift 2
    done
    ((${#dyna[@]})) && align+=(--dyna "${dyna[@]}")
    [[ -n $gender && -n $licensed ]] &&
        refuse "--gender $gender with licensed files; expected one of the two. The body model of --smpl has its gender."
    [[ -n $preset && -n $aligner$( ((${#train[@]})) && echo dmpl) ]] &&
        refuse "--preset $preset with --aligner or --dmpl; expected one of them. The paper's words leave no choice."
    if [[ -n $preset ]]; then
        aligner=sgd align+=(--aligner sgd)
        train_ae=(--preset "$preset") train=(--predictors dsnet_faithful)
    fi
    [[ -n $run ]] || run=$profile$([[ $gender != male ]] || echo _male)${preset:+_$preset}
    [[ -n $seeds ]] || seeds=$([[ $profile == paper ]] && echo 3 || echo 1)
    ((${#train[@]})) && [[ $aligner != sgd ]] && train+=(dsnet_plus)
    local stage again root=${DSNET_RUNS:-runs}
    for stage in corpus align train-ae encode train infer decode evaluate; do
        [[ $stage == corpus && -n $licensed ]] || run_stage "$stage" "$run" "$seed"
    done
    for ((again = 1; again < seeds; again++)); do
        share_alignment "$root/$run" "$root/$run-seed$((seed + again))"
        for stage in train infer decode evaluate; do
            run_stage "$stage" "$run-seed$((seed + again))" $((seed + again))
        done
    done
    run_stage report "$run" "$seed"
    echo "report: $root/$run/report/report.html" >&2
}

# With the options that `run_stages` has found.
run_stage() {
    local stage=$1 common=(--profile "$profile" --run "$2" --seed "$3" ${engine[@]+"${engine[@]}"})
    echo "== dsnet $stage$([[ $2 == "$run" ]] || echo " --run $2")" >&2
    case $stage in
        corpus) .venv/bin/dsnet corpus "${common[@]}" ${corpus[@]+"${corpus[@]}"} ;;
        align) .venv/bin/dsnet align "${common[@]}" ${align[@]+"${align[@]}"} ;;
        train-ae) .venv/bin/dsnet train-ae "${common[@]}" ${train_ae[@]+"${train_ae[@]}"} ;;
        train) .venv/bin/dsnet train "${common[@]}" ${train[@]+"${train[@]}"} ;;
        infer) .venv/bin/dsnet infer "${common[@]}" ${infer[@]+"${infer[@]}"} ;;
        *) .venv/bin/dsnet "$stage" "${common[@]}" ;;
    esac
}

# A run of other seeds learns from the same alignment and codes: its own are links.
share_alignment() {
    local stage
    mkdir -p "$2"
    for stage in corpus truth align align_robust train-ae encode; do
        [[ ! -e $1/$stage || -e $2/$stage ]] || ln -sfn "../${1##*/}/$stage" "$2/$stage"
    done
}

print_head() {
    sed -n '2,/^set /s/^# \{0,1\}//p' "${BASH_SOURCE[0]##*/}"
}

case ${1:-} in
    -h | --help) print_head ;;
    setup) setup $for_everything ;;
    test) shift; setup $for_everything; run_tests "$@" ;;
    *)
        [[ " $* " == *" --engine "* ]] && extras=$for_everything || extras=$for_runs
        setup $extras
        run_stages "$@"
        ;;
esac; exit # on one line: bash reads on in the file, which may be another one after hours
