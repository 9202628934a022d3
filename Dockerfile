# socialbot with speech, installed from the locked requirements, for a user without root rights.
#   docker build -t socialbot .
#   docker run --rm -v "$PWD/runs:/home/robot/runs" socialbot demo warehouse
# Live graphs need the network of the host (DDS), and the devices they use:
#   docker run --rm -it --network host --ipc host --device /dev/video0 --device /dev/snd --group-add video --group-add audio socialbot up
FROM python:3.11-slim-bookworm

WORKDIR /opt/socialbot
COPY requirements.lock ./
RUN python -m venv /opt/venv \
    && /opt/venv/bin/pip install --no-cache-dir --require-hashes -r requirements.lock
COPY pyproject.toml README.md LICENSE ./
COPY socialbot ./socialbot
RUN /opt/venv/bin/pip install --no-cache-dir --no-deps --no-build-isolation . \
    && useradd --create-home --uid 1000 --groups audio,video robot

ENV PATH=/opt/venv/bin:$PATH
USER 1000
WORKDIR /home/robot
ENTRYPOINT ["socialbot"]
CMD ["--help"]
