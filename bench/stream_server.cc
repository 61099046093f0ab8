// The least that gRPC costs, for bench/stream.py --native-server: one shared slice, sent again and again to every client that
// calls anything, by the library's own threads.
//
//   g++ -O2 -std=c++17 bench/stream_server.cc -o stream_server $(pkg-config --cflags --libs grpc++)
//   stream_server FILE      prints its port; a line starts the measurement, the end of the input ends it

#include <grpcpp/generic/async_generic_service.h>
#include <grpcpp/grpcpp.h>
#include <sys/resource.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <iterator>
#include <memory>
#include <string>

namespace {

double cpu() {
  rusage usage;
  getrusage(RUSAGE_SELF, &usage);
  return usage.ru_utime.tv_sec + usage.ru_stime.tv_sec + 1e-6 * (usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
}

// One stream; deletes itself when it is over.
class Stream : public grpc::ServerGenericBidiReactor {
 public:
  explicit Stream(const grpc::Slice* set) : set_(set) { StartRead(&request_); }
  void OnReadDone(bool ok) override { proceed(ok); }
  void OnWriteDone(bool ok) override { proceed(ok); }
  void OnDone() override { delete this; }

 private:
  void proceed(bool ok) {
    if (!ok) {
      Finish(grpc::Status::CANCELLED);
      return;
    }
    message_ = grpc::ByteBuffer(set_, 1);
    StartWrite(&message_);
  }
  const grpc::Slice* set_;
  grpc::ByteBuffer request_, message_;
};

class Service : public grpc::CallbackGenericService {
 public:
  explicit Service(const std::string& set) : set_(set) {}
  grpc::ServerGenericBidiReactor* CreateReactor(grpc::GenericCallbackServerContext*) override {
    return new Stream(&set_);
  }

 private:
  grpc::Slice set_;
};

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) return 2;
  std::ifstream file(argv[1], std::ios::binary);
  Service service(std::string(std::istreambuf_iterator<char>(file), {}));
  grpc::ServerBuilder builder;
  int port = 0;
  builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port);
  builder.RegisterCallbackGenericService(&service);
  builder.SetMaxSendMessageSize(-1);
  const std::unique_ptr<grpc::Server> server = builder.BuildAndStart();
  std::printf("%d\n", port);
  std::fflush(stdout);
  std::string line;
  std::getline(std::cin, line);
  const auto begin = std::chrono::steady_clock::now();
  const double cpu_begin = cpu();
  while (std::getline(std::cin, line)) {
  }
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  rusage usage;
  getrusage(RUSAGE_SELF, &usage);
  std::printf("{\"cpu\": %f, \"rss\": %f}\n", (cpu() - cpu_begin) / seconds,
              static_cast<double>(usage.ru_maxrss) / 1024.0);
  std::fflush(stdout);
  std::_Exit(0);
}
