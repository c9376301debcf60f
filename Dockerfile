# docker build --tag tjscan .
# docker run --rm --volume "$PWD:/work" tjscan init paper
# docker run --rm --volume "$PWD:/work" tjscan scan paper.toml
FROM python:3.11-slim-bookworm
# What Open3D and Pinocchio load and a slim base lacks.
RUN apt-get update \
    && apt-get install --yes --no-install-recommends \
        libegl1 libgl1 libgomp1 libidn2-0 libudev1 libusb-1.0-0 libx11-6 \
    && rm -rf /var/lib/apt/lists/*
COPY pyproject.toml constraints.txt README.md LICENSE /opt/tjscan/
COPY cad /opt/tjscan/cad
COPY examples /opt/tjscan/examples
COPY tjscan /opt/tjscan/tjscan
RUN pip install --no-cache-dir --constraint /opt/tjscan/constraints.txt /opt/tjscan
WORKDIR /work
ENTRYPOINT ["tjscan"]
CMD ["--help"]
