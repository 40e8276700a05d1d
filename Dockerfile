# firnline as a command: docker run --rm -v "$PWD:/work" firnline plan site.geojson --prior dem.tif
FROM python:3.13-slim
# OpenCV and MuJoCo load these two.
RUN apt-get update \
    && apt-get install --yes --no-install-recommends libgl1 libglib2.0-0 \
    && rm -rf /var/lib/apt/lists/*
COPY . /src
RUN pip install --no-cache-dir --constraint /src/constraints.txt "/src[bags]"
WORKDIR /work
ENTRYPOINT ["firnline"]
CMD ["--help"]
