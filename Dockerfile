# ROS 2 Jazzy with hunt_ros; without arguments it runs the demo.
#
#   docker build -t hunt_ros .
#   docker run --rm -it -v hunt_recordings:/work hunt_ros
#   docker run --rm -it --network host hunt_ros hunt run --simulated --page
FROM ros:jazzy-ros-base

ENV DEBIAN_FRONTEND=noninteractive
RUN apt-get update \
    && apt-get install --yes --no-install-recommends \
        python3-venv python3-numpy python3-scipy python3-matplotlib python3-rich python3-yaml \
        python3-serial python3-tornado \
    && rm -rf /var/lib/apt/lists/*

# In a venv that sees the packages of Ubuntu and ROS: Ubuntu's own Python takes nothing from pip.
ENV VIRTUAL_ENV=/opt/hunt PATH=/opt/hunt/bin:$PATH
RUN python3 -m venv --system-site-packages "$VIRTUAL_ENV" \
    && pip install --no-cache-dir 'setuptools<80' wheel rosbags mcap lz4 zstandard numba filterpy
COPY . /src/hunt_ros
# The machine code of the kernels is kept beside them.
RUN pip install --no-cache-dir --no-deps --no-build-isolation /src/hunt_ros && hunt compile

RUN useradd --create-home hunt && mkdir /work && chown hunt /work
USER hunt
WORKDIR /work

# The entry point of the image sources /opt/ros/jazzy/setup.bash.
CMD ["hunt", "demo"]
