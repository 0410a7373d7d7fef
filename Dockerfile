# A CPU image of mam-sim with simulator, learning and LeRobot.
#
#   docker build -t mam-sim .
#   docker run --rm --user "$(id -u):$(id -g)" -v "$PWD":/work mam-sim make-env photo.jpg --out nightstand
#
# PyTorch's default wheels bring several GB of CUDA libraries. To leave them out, give the address of an
# index with PyTorch's CPU wheels:   docker build --build-arg MAM_SIM_TORCH_INDEX=... -t mam-sim .
FROM python:3.12-slim

ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore
WORKDIR /opt/mam-sim

# libraries of the ray caster and the simulator, FFmpeg, Vulkan on the CPU
COPY scripts/system_packages.sh scripts/
RUN bash scripts/system_packages.sh && rm -rf /var/lib/apt/lists/*

# torch first: it is the largest layer and changes least
ARG MAM_SIM_TORCH_INDEX=
COPY constraints.txt ./
RUN pip install -c constraints.txt ${MAM_SIM_TORCH_INDEX:+--extra-index-url "$MAM_SIM_TORCH_INDEX" --prefer-binary} torch torchvision

# The compiler is for the few packages without wheels, and leaves with the same layer. opencv-python
# (wanted by sapien) and opencv-python-headless own the same folder: the headless one stays alone.
COPY . .
RUN apt-get update -qq && apt-get install -y -qq --no-install-recommends gcc g++ libc6-dev \
    && pip install -c constraints.txt ".[all]" ./plugins/mam_sim_models ./plugins/mam_sim_formats ./benchmarks/paper \
    && pip install --no-deps ./plugins/lerobot_policy_mam_sim ./plugins/lerobot_robot_mam_sim ./plugins/mam_sim_bench \
    && pip uninstall -y opencv-python \
    && pip install --no-deps --force-reinstall -c constraints.txt opencv-python-headless \
    && apt-get purge -y -qq gcc g++ libc6-dev && apt-get autoremove -y -qq \
    && rm -rf /var/lib/apt/lists/* build

# fails the build where something that mam-sim needs is missing
RUN mam-sim doctor

ENV HF_HUB_OFFLINE=1 HOME=/tmp
WORKDIR /work
ENTRYPOINT ["mam-sim"]
CMD ["--help"]
